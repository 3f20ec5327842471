/* What the display needs of a board. board_avr.c has it for the ATmega328P; another chip is another such file. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

/* Analog inputs. */
enum { CURRENT, PLATE, SINK, FLUX, GUARD, INPUTS };
/* A full duty: the whole supply. The bridge obeys in steps of one of it. */
#define FULL 12800
/* A full count of the converter. */
#define COUNTS 1024

struct sum {
  uint32_t total;
  uint16_t count;
};

/* Take the pins over with the bridge off, begin to convert, begin to count milliseconds; the watchdog runs. */
void board_begin(void);
/* Why the chip has started, in one word. */
const char *board_started(void);
/* Rest until something happens; tell whether a millisecond has begun. */
uint8_t board_turn(void);
/* Tell the watchdog that all is well. */
void board_alive(void);
/* Return what an input has gathered since the last call. */
struct sum board_take(uint8_t input);
/* Set the mean voltage, signed, in parts of FULL; the bridge is on. */
void board_drive(int16_t duty);
/* Take the bridge off at once. */
void board_off(void);
/* Return a byte of the host, or -1. */
int16_t board_get(void);
void board_put(char byte);
/* One byte that outlives resets and power; 0xFF if it was never written. */
uint8_t board_kept(void);
void board_keep(uint8_t value);

#endif
