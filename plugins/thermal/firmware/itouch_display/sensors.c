/* Counts to degrees, W/m2 and amperes: means over many samples, which noise of half a count makes finer than a count. */
#include <math.h>

#include "board.h"
#include "config.h"
#include "display.h"

#define REFERENCE_V 5.0f
#define AMPS_PER_COUNT (REFERENCE_V / COUNTS / SENSE_V_PER_A)
#define FLUX_PER_COUNT (REFERENCE_V / COUNTS * FLUX_PER_V)
/* Milliseconds between two temperatures, and the weight of the newest in a rate; with no current flowing, so many
   milliseconds show where the current's zero is. */
#define EVERY_MS 10
#define RATE_WEIGHT 0.2f
#define ZERO_MS 50
/* A flux is the mean of so many milliseconds before the host asks: whenever it does, it is half as old. */
#define FLUX_MS 20
/* Samples of a millisecond that a sum of 16 bits holds; there are more only behind a program that was late. */
#define MOST_SAMPLES 60
#define COLDEST_C -20.0f
#define HOTTEST_C 90.0f

struct readings now = {NAN, NAN, NAN, 0.0f, NAN, NAN};

static float mean(struct sum sum) { return sum.count ? ((float)sum.total + 0.5f * sum.count) / sum.count : NAN; }

/* A thermistor that is open or short, or anything that no display can be, is no temperature. */
static float celsius(float counts) {
  float part = counts / COUNTS;
  if (!(part > 0.0f && part < 1.0f)) return NAN;
  float found = 1.0f / (1.0f / 298.15f + logf(SERIES_OHM / NTC_OHM_25 * part / (1.0f - part)) / NTC_B_K) - 273.15f;
  return found >= COLDEST_C && found <= HOTTEST_C ? found : NAN;
}

struct ahead {
  float last, rate;
};

/* Return where the plate itself is by now. */
static float extrapolated(struct ahead *state, float found) {
  float rate = (found - state->last) * (1000.0f / EVERY_MS);
  state->last = found;
  if (isnan(rate)) rate = 0.0f;
  state->rate += RATE_WEIGHT * (rate - state->rate);
  return found + NTC_LAG_S * state->rate;
}

/* The mean of two: one temperature is of 10 ms, one that is told is of 20. */
static float smoothed(float *before, float found) {
  float both = isnan(*before) || isnan(found) ? found : 0.5f * (*before + found);
  *before = found;
  return both;
}

static float zero = COUNTS / 2;
static uint8_t zeroing;

uint8_t sensors_zeroed(void) { return zeroing >= ZERO_MS; }

/* Return the current of the last millisecond [A]; NaN: not a sample. */
float sensors_current(void) {
  static float total;
  float counts = mean(board_take(CURRENT));
  if (isnan(counts)) return NAN;
  if (!sensors_zeroed()) {
    total = zeroing ? total + counts : counts;
    if (++zeroing == ZERO_MS) zero = total / ZERO_MS;
    return 0.0f;
  }
  return (counts - zero) * AMPS_PER_COUNT;
}

/* The samples of the flux, a sum for each of the last milliseconds, in a ring; and the sum of all that is in it. */
static uint16_t sums[FLUX_MS];
static uint8_t counts[FLUX_MS], at_end[FLUX_MS], newest;
static struct sum fluxes;
static uint8_t ends;

static void gather_flux(void) {
  struct sum taken = board_take(FLUX);
  if (taken.count > MOST_SAMPLES) taken.total /= taken.count, taken.count = 1;
  newest = newest + 1 < FLUX_MS ? newest + 1 : 0;
  fluxes.total -= sums[newest], fluxes.count -= counts[newest], ends -= at_end[newest];
  sums[newest] = (uint16_t)taken.total;
  counts[newest] = (uint8_t)taken.count;
  at_end[newest] = taken.count && (taken.total <= 2 * taken.count || taken.total >= (uint32_t)(COUNTS - 2) * taken.count);
  fluxes.total += sums[newest], fluxes.count += counts[newest], ends += at_end[newest];
}

/* Return the flux for the host [W/m2]; an amplifier that was at its end meanwhile says nothing. */
float sensors_flux(void) { return ends ? NAN : (mean(fluxes) - COUNTS / 2) * FLUX_PER_COUNT; }

/* Once a millisecond; tell whether there are new temperatures. */
uint8_t sensors_turn(void) {
  static struct ahead plates = {NAN, 0.0f}, guards = {NAN, 0.0f};
  static float plate_before = NAN, sink_before = NAN;
  static uint8_t since;
  gather_flux();
  if (++since < EVERY_MS) return 0;
  since = 0;
  float plate = celsius(mean(board_take(PLATE))), guard = celsius(mean(board_take(GUARD)));
  float one = extrapolated(&plates, plate), other = extrapolated(&guards, guard);
  now.hottest = fmaxf(one, other);
  now.coldest = fminf(one, other);
  now.plate = smoothed(&plate_before, plate);
  now.guard = guard;
  now.sink = smoothed(&sink_before, celsius(mean(board_take(SINK))));
  return 1;
}
