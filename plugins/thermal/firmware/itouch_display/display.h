/* The display: what it knows and does; nothing here is of one board. */
#ifndef DISPLAY_H
#define DISPLAY_H

#include <stdint.h>

/* Why it has cut itself off; kept until the host releases it. */
enum { FINE, PLATE_HOT, PLATE_COLD, SINK_HOT, PLATE_SENSOR, SINK_SENSOR, SENSORS_DIFFER, WRONG_CURRENT, NO_SAMPLES, CUTS };
extern const char *const cut_names[CUTS + 1];

/* Newest readings: degrees Celsius, amperes; NaN where a sensor is open or short. */
struct readings {
  float plate, sink, guard, current;
  float hottest, coldest; /* of both thermistors of the plate, ahead by their lag */
};
extern struct readings now;

/* sensors.c */
uint8_t sensors_turn(void);
float sensors_current(void);
uint8_t sensors_zeroed(void);
float sensors_flux(void);

/* control.c */
extern uint8_t cut;
extern float wanted;   /* what the host asks for [A]; positive cools the plate */
extern uint8_t folded; /* the current is held back because the plate is near a limit */
void control_begin(void);
void control_turn(void);
void control_heard(void);
void control_stop(uint8_t cause);
uint8_t control_release(void);

/* protocol.c */
void protocol_turn(void);

/* display.c */
void display_begin(void);
void display_turn(void);

#endif
