/* The display's chip in simavr, with bridge, filter and module at its pins, as a library for the tests' plant.

   Whoever calls gives volts at the inputs and the module's thermal voltage for some cycles, and bytes for the serial
   port; gets the mean current and what the chip has said. */
#include <simavr/avr_adc.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_io.h>
#include <stdlib.h>
#include <string.h>

enum { SLOT = 800, SUBSTEPS = 5, CHANNELS = 8, CURRENT_INPUT = 3, ROOM = 4096 };
#define HERTZ 16e6
#define PORTB_AT 0x25
#define DDRB_AT 0x24
#define ADCSRA_AT 0x7A
#define TCCR1A_AT 0x80
#define TCCR1B_AT 0x81
#define ICR1_AT 0x86
#define OCR1A_AT 0x88
#define OCR1B_AT 0x8A
#define FAST_TO_ICR 14
#define LOOP_FOREVER 0xCFFF /* rjmp to itself: every program has one behind its end */

/* Volts, ohms, henries, farads. `sense` is a gain [V/A] around half the reference; NaN in `volts[3]`: as measured. */
struct circuit {
  double supply, resistance, inductance, capacitance, sense, noise, thermal;
  double volts[CHANNELS];
};

struct told {
  double current, square, duty, enabled, resets;
};

struct line {
  unsigned char bytes[ROOM];
  int used, taken;
};

struct chip {
  avr_t *avr;
  elf_firmware_t program;
  struct circuit circuit;
  struct line in, out;
  avr_irq_t *receive, *inputs;
  uint64_t random;
  avr_cycle_count_t slot_end, byte_due;
  uint32_t byte_cycles;
  double coil, cap, current;
  avr_flashaddr_t hang_at;
  int resets;
};

/* ---- noise: xorshift and the sum of four uniforms ---- */

static double uniform(struct chip *chip) {
  chip->random ^= chip->random << 13;
  chip->random ^= chip->random >> 7;
  chip->random ^= chip->random << 17;
  return (double)(chip->random >> 11) / 9007199254740992.0;
}

static double gauss(struct chip *chip) {
  double sum = -2.0;
  for (int i = 0; i < 4; i++) sum += uniform(chip);
  return sum * 1.7320508;
}

/* ---- what the chip does to its pins ---- */

/* A conversion begins: its input gets the value of this moment. simavr takes whole millivolts and 1023 counts. */
static void converts(avr_irq_t *irq, uint32_t value, void *param) {
  struct chip *chip = param;
  union {
    avr_adc_mux_t mux;
    uint32_t word;
  } asked = {.word = value};
  unsigned source = asked.mux.src;
  (void)irq;
  if (source >= CHANNELS) return;
  double volts = chip->circuit.volts[source];
  if (volts != volts) volts = 2.5 + chip->circuit.sense * chip->current;
  double millivolts = (volts + chip->circuit.noise * gauss(chip)) * 1e3 * 1024.0 / 1023.0 + uniform(chip);
  avr_raise_irq(chip->inputs + source, millivolts < 0.0 ? 0 : millivolts > 5000.0 ? 5000 : (uint32_t)millivolts);
}

static void says(avr_irq_t *irq, uint32_t value, void *param) {
  struct line *out = &((struct chip *)param)->out;
  (void)irq;
  if (out->used < ROOM) out->bytes[out->used++] = (unsigned char)value;
}

/* ---- the circuit, over one period of the bridge at its mean voltage ---- */

static void circuit_step(struct chip *chip, double bridge, int enabled) {
  const struct circuit *c = &chip->circuit;
  double dt = SLOT / HERTZ / SUBSTEPS;
  for (int i = 0; i < SUBSTEPS; i++) {
    if (enabled) chip->coil += dt / c->inductance * (bridge - chip->cap);
    else chip->coil = 0.0;
    double rise = dt / c->capacitance;
    chip->cap = (chip->cap + rise * (chip->coil + c->thermal / c->resistance)) / (1.0 + rise / c->resistance);
  }
  chip->current = (chip->cap - c->thermal) / c->resistance;
}

/* The mean of a half of the bridge: of the timer if it has the pin, else of the port. The simulator's pins do not follow
   a compare value that changes, its registers do; a period is a slot long, so each value is seen once. */
static double half_of_bridge(const uint8_t *data, int half) {
  int compare = data[TCCR1A_AT] >> (half ? 4 : 6) & 3, mode = (data[TCCR1A_AT] & 3) | (data[TCCR1B_AT] & 0x18) >> 1;
  int top = data[ICR1_AT] | data[ICR1_AT + 1] << 8, at = half ? OCR1B_AT : OCR1A_AT;
  int running = (data[TCCR1B_AT] & 7) == 1;
  if (!(data[DDRB_AT] >> (1 + half) & 1)) return 0.5;
  if (compare == 2 && mode == FAST_TO_ICR && running && top == SLOT - 1)
    return ((data[at] | data[at + 1] << 8) + 1.0) / SLOT;
  return data[PORTB_AT] >> (1 + half) & 1;
}

static void slot(struct chip *chip, struct told *told) {
  const uint8_t *data = chip->avr->data;
  int enabled = data[DDRB_AT] & data[PORTB_AT] & 1;
  double duty = half_of_bridge(data, 0) - half_of_bridge(data, 1);
  circuit_step(chip, enabled ? duty * chip->circuit.supply : 0.0, enabled);
  told->current += chip->current;
  told->square += chip->current * chip->current;
  told->duty += enabled ? duty : 0.0;
  told->enabled += enabled;
  if (chip->in.taken < chip->in.used && chip->avr->cycle >= chip->byte_due) {
    avr_raise_irq(chip->receive, chip->in.bytes[chip->in.taken++]);
    chip->byte_due = chip->avr->cycle + chip->byte_cycles;
  }
}

/* ---- for the caller ---- */

static void quiet(avr_t *avr, const int level, const char *format, va_list list) {
  (void)avr, (void)level, (void)format, (void)list;
}

static void rest(avr_t *avr, avr_cycle_count_t cycles) { (void)avr, (void)cycles; }

static void (*core_reset)(avr_t *avr);
static struct chip *resetting;

static void counted_reset(avr_t *avr) {
  if (core_reset) core_reset(avr);
  if (resetting && resetting->avr == avr) resetting->resets++;
}

static void connect(struct chip *chip) {
  avr_t *avr = chip->avr;
  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  chip->receive = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
  chip->inputs = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), says, chip);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), converts, chip);
}

struct chip *chip_new(const char *elf, uint32_t seed, double baud) {
  struct chip *chip = calloc(1, sizeof *chip);
  avr_global_logger_set(quiet);
  if (!chip || elf_read_firmware(elf, &chip->program)) return NULL;
  avr_t *avr = chip->avr = avr_make_mcu_by_name("atmega328p");
  if (!avr) return NULL;
  avr_init(avr);
  avr->frequency = (uint32_t)HERTZ;
  avr->sleep = rest;
  avr_load_firmware(avr, &chip->program);
  avr->frequency = (uint32_t)HERTZ;
  avr->vcc = avr->avcc = avr->aref = 5000;
  avr_regbit_set(avr, avr->reset_flags.porf);
  core_reset = avr->reset == counted_reset ? core_reset : avr->reset;
  avr->reset = counted_reset;
  for (avr_flashaddr_t at = 0; at + 1 < avr->codeend; at += 2)
    if ((avr->flash[at] | avr->flash[at + 1] << 8) == LOOP_FOREVER) chip->hang_at = at;
  chip->random = 0x9E3779B97F4A7C15ull ^ ((uint64_t)seed + 1) * 0xBF58476D1CE4E5B9ull;
  chip->byte_cycles = (uint32_t)(10.0 * HERTZ / baud);
  connect(chip);
  return chip;
}

void chip_free(struct chip *chip) {
  avr_terminate(chip->avr);
  free(chip);
}

/* Run for so many periods of the bridge (50 us). Returns how many bytes the chip has said, or -1 if its core is dead. */
int chip_run(struct chip *chip, int slots, const struct circuit *circuit, const unsigned char *bytes, int count,
             struct told *told) {
  avr_t *avr = chip->avr;
  chip->circuit = *circuit;
  resetting = chip;
  memset(told, 0, sizeof *told);
  if (chip->in.taken == chip->in.used) chip->in.taken = chip->in.used = 0;
  for (int i = 0; i < count && chip->in.used < ROOM; i++) chip->in.bytes[chip->in.used++] = bytes[i];
  chip->out.used = 0;
  for (int i = 0; i < slots; i++) {
    chip->slot_end += SLOT;
    while (avr->cycle < chip->slot_end) {
      int state = avr_run(avr);
      if (state == cpu_Done || state == cpu_Crashed) return -1;
    }
    slot(chip, told);
  }
  told->current /= slots, told->square /= slots, told->duty /= slots, told->enabled /= slots;
  told->resets = chip->resets;
  return chip->out.used;
}

void chip_said(struct chip *chip, unsigned char *bytes) { memcpy(bytes, chip->out.bytes, chip->out.used); }

/* 0 brown-out, 1 the reset pin, 2 power; the pins float until the program has come up again. */
void chip_reset(struct chip *chip, int how) {
  avr_t *avr = chip->avr;
  resetting = chip;
  avr_reset(avr);
  avr_regbit_set(avr, how == 0 ? avr->reset_flags.borf : how == 1 ? avr->reset_flags.extrf : avr->reset_flags.porf);
  chip->in.used = chip->in.taken = 0;
}

/* The program goes nowhere any more, its interrupts go on or not. */
void chip_hang(struct chip *chip, int interrupts) {
  chip->avr->pc = chip->hang_at;
  if (!interrupts) chip->avr->sreg[S_I] = 0;
}

/* The converter stops. */
void chip_stop_converter(struct chip *chip) { chip->avr->data[ADCSRA_AT] &= (uint8_t)~0x88; }
