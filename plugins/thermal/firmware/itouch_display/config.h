/* What differs from one display to another: measure, write it here, compile again. Units are in the names. */
#ifndef CONFIG_H
#define CONFIG_H

#define NAME "uno" /* told to the host; one word */
#define BAUD 250000UL /* exact at 16 MHz; 115200 would be 2 % off */

/* The drive: supply of the bridge, module with leads and filter, its Seebeck coefficient. */
#define SUPPLY_V 12.0f
#define MODULE_OHM 1.95f
#define MODULE_V_PER_K 0.052f
#define MODULE_W_PER_K 0.54f
/* Greatest current, how fast it may change, and the time constant with which the loop corrects it. */
#define MOST_A 3.0f
#define SLEW_A_PER_S 100.0f
#define LOOP_S 0.015f

/* Current sense amplifier around half the reference: 15 mOhm times 50. */
#define SENSE_V_PER_A 0.75f
/* Thermistors to ground, a resistor of the same nominal value to the reference; all three alike. */
#define SERIES_OHM 10e3f
#define NTC_OHM_25 10e3f
#define NTC_B_K 3950.0f
/* How far a glued thermistor lags behind the plate: the trips see its reading extrapolated by that. */
#define NTC_LAG_S 0.2f
/* Flux film and its amplifier: W/m2 a volt at the pin, around half the reference; 1 uV m2/W times 250. */
#define FLUX_PER_V 4000.0f

/* Cut-off, between the program's trips (12 and 42 degC) and what never passes (8 and 45 degC). */
#define PLATE_COLD_C 10.0f
#define PLATE_HOT_C 43.0f
/* The sink: so low that its heat, after a cut and with the fan dead, cannot bring the plate above 45 degC. */
#define SINK_HOT_C 44.0f
/* Its heat capacity and its resistance to the room: what the sink's thermistor shows must be about what they say. */
#define SINK_J_PER_K 150.0f
#define SINK_K_PER_W 0.5f
#define SINK_OFF_K 5.0f
/* Where, before the cut, the current begins to be held back and where none is left [K]. */
#define FOLD_BEGIN_K 1.4f
#define FOLD_END_K 0.3f
/* Both thermistors of the plate must agree. */
#define DIFFER_K 2.0f

/* Without an order for so long the current goes to zero. */
#define SILENCE_MS 200

#endif
