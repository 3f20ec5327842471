/* The current, held by a loop; and everything that takes it away again. */
#include <math.h>

#include "board.h"
#include "config.h"
#include "display.h"

#define MS 0.001f
/* What the loop may add to what module and supply are known to need [V]: so far it can be wrong. */
#define TRIM_V 1.0f
#define TRIM_PART 0.3f
#define MOST_DUTY 0.9f
/* A current that is not what is wanted: by how much, for how long. */
#define WRONG_A 0.25f
#define WRONG_PART 0.15f
#define WRONG_MS 60
/* So many temperatures in a row must be past a trip; an open sensor needs no second look. */
#define TWICE 2
#define DIFFER_TIMES 8
#define NO_SAMPLES_MS 5
/* Temperatures between two looks at the sink's balance; how fast its constant is learnt, a look (250 s); how wrong heat
   capacity and resistance may be. */
#define SINK_TIMES 20
#define SINK_LEARN 0.0008f
#define SINK_PART 0.35f

const char *const cut_names[CUTS + 1] = {
  "none", "plate-hot", "plate-cold", "sink-hot", "plate-sensor", "sink-sensor", "sensors-differ", "current",
  "converter", "unknown",
};

uint8_t cut, folded;
float wanted;
static uint8_t silent = 1;
static uint16_t unheard;
static float target, trim;

void control_begin(void) {
  cut = board_kept();
  if (cut == 0xFF) cut = FINE;
  if (cut > CUTS) cut = CUTS;
}

void control_heard(void) { unheard = 0, silent = 0; }

/* The bridge goes off at once; why is kept where neither a reset nor a lost supply can forget it. */
void control_stop(uint8_t cause) {
  board_off();
  target = trim = wanted = 0.0f;
  if (cut != FINE) return;
  cut = cause;
  board_keep(cause);
}

static uint8_t wrong(void) {
  if (isnan(now.plate) || isnan(now.guard)) return PLATE_SENSOR;
  if (isnan(now.sink)) return SINK_SENSOR;
  if (now.hottest > PLATE_HOT_C) return PLATE_HOT;
  if (now.coldest < PLATE_COLD_C) return PLATE_COLD;
  return now.sink > SINK_HOT_C ? SINK_HOT : FINE;
}

/* Release the cut-off if its causes are gone. */
uint8_t control_release(void) {
  if (wrong() != FINE || now.hottest - now.coldest > DIFFER_K) return 0;
  cut = FINE;
  board_keep(FINE);
  return 1;
}

static void watch_temperatures(void) {
  static uint8_t last, times, differ;
  uint8_t found = wrong();
  times = found != FINE && found == last ? times + 1 : 1;
  last = found;
  if (found != FINE && (times >= TWICE || found == PLATE_SENSOR || found == SINK_SENSOR)) control_stop(found);
  differ = now.hottest - now.coldest > DIFFER_K ? differ + 1 : 0;
  if (differ >= DIFFER_TIMES) control_stop(SENSORS_DIFFER), differ = 0;
}

/* A thermistor that has come off the sink would let it heat up unseen: by its heat capacity, its way to the room and the
   heat of the module its temperature is known but for a constant, which is learnt slowly. */
static void watch_sink(void) {
  static float rise, offset = NAN, mean_current, mean_square;
  static uint8_t since;
  mean_current += now.current;
  mean_square += now.current * now.current;
  if (++since < SINK_TIMES) return;
  since = 0;
  float current = mean_current / SINK_TIMES, square = mean_square / SINK_TIMES;
  mean_current = mean_square = 0.0f;
  if (isnan(now.sink) || isnan(now.plate)) return;
  float heat = MODULE_V_PER_K * (now.sink + 273.15f) * current + 0.5f * MODULE_OHM * square
      - MODULE_W_PER_K * (now.sink - now.plate);
  rise += SINK_TIMES * 0.01f / SINK_J_PER_K * (heat - rise / SINK_K_PER_W);
  float other = now.sink - rise;
  if (isnan(offset)) offset = other;
  offset += SINK_LEARN * (other - offset);
  if (fabsf(other - offset) > SINK_OFF_K + SINK_PART * fabsf(rise)) control_stop(SINK_SENSOR), offset = other;
}

/* Return what the plate's temperature leaves of a current. */
static float held_back(float amps) {
  float room = amps > 0.0f ? now.coldest - PLATE_COLD_C : PLATE_HOT_C - now.hottest;
  float share = (room - FOLD_END_K) / (FOLD_BEGIN_K - FOLD_END_K);
  folded = share < 1.0f;
  if (!folded) return amps;
  return share > 0.0f ? share * amps : 0.0f;
}

static float towards(float from, float to) {
  float step = SLEW_A_PER_S * MS;
  return to > from + step ? from + step : to < from - step ? from - step : to;
}

static void drive(float found) {
  float known = target * MODULE_OHM + MODULE_V_PER_K * (now.sink - now.plate);
  float most = TRIM_V + TRIM_PART * fabsf(known);
  static float before[2]; /* what flows now is what was meant when filter and converter began with it */
  trim += MODULE_OHM * (MS / LOOP_S) * (before[1] - found);
  before[1] = before[0], before[0] = target;
  trim = fmaxf(-most, fminf(most, trim));
  float duty = fmaxf(-MOST_DUTY, fminf(MOST_DUTY, (known + trim) / SUPPLY_V));
  board_drive((int16_t)(duty * FULL + (duty < 0.0f ? -0.5f : 0.5f)));
}

static void watch_current(float found) {
  static float smooth, meant;
  static uint8_t bad;
  smooth += 0.1f * (found - smooth);
  meant += 0.1f * (target - meant);
  bad = fabsf(smooth - meant) > WRONG_A + WRONG_PART * fabsf(meant) ? bad + 1 : 0;
  now.current += 0.05f * (found - now.current);
  if (bad >= WRONG_MS) control_stop(WRONG_CURRENT), bad = 0;
}

/* Once a millisecond. */
void control_turn(void) {
  static uint8_t missing;
  float found = sensors_current();
  if (isnan(found)) {
    if (++missing >= NO_SAMPLES_MS) control_stop(NO_SAMPLES), missing = NO_SAMPLES_MS;
    if (cut != FINE) board_alive();
    return;
  }
  missing = 0;
  board_alive();
  if (sensors_turn() && sensors_zeroed()) {
    watch_temperatures();
    watch_sink();
  }
  if (unheard < SILENCE_MS) unheard++;
  else silent = 1;
  if (!sensors_zeroed()) return;
  watch_current(found);
  if (cut != FINE || isnan(now.plate)) {
    board_off();
    return;
  }
  target = towards(target, silent ? 0.0f : held_back(wanted));
  if (silent && target == 0.0f) {
    board_off();
    trim = 0.0f;
  } else {
    drive(found);
  }
}
