/* ATmega328P at 16 MHz (Arduino Uno, Nano): timer 1 drives the bridge, the converter and the serial port interrupt.

   pin 9, 10  the two halves of the bridge; 8: its enable, with 10 kOhm to ground, so that a chip in reset is off
   A0 plate   A1 sink   A2 flux   A3 current   A4 the plate's second thermistor */
#include "board.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "config.h"

/* 20 kHz. Each half stands at half the supply and moves from there against the other: no dead zone at zero. Sixteenths
   of a count are spread over periods. Of the timer's modes the simulator has this one (14), if ICR1 is written first. */
#define TOP 799
#define HALF (FULL / 2)
#define PERIODS_PER_MS 20
#define ENABLE _BV(PORTB0)

static volatile uint16_t whole_a = HALF >> 4, whole_b = HALF >> 4;
static volatile uint8_t part_a, part_b;
static volatile uint8_t ticks;

static uint8_t started __attribute__((section(".noinit")));

/* Before anything else: why we are here; and a watchdog that has bitten is still running. */
void board_first(void) __attribute__((naked, used, section(".init3")));
void board_first(void) {
  started = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

const char *board_started(void) {
  if (started & _BV(WDRF)) return "watchdog";
  if (started & _BV(BORF) && !(started & _BV(PORF))) return "brown-out";
  if (started & _BV(EXTRF)) return "reset";
  return started & _BV(PORF) ? "power" : "unknown";
}

/* ---- bridge ---- */

ISR(TIMER1_OVF_vect) {
  static uint8_t rest_a, rest_b, beat;
  uint16_t a = whole_a, b = whole_b;
  rest_a += part_a;
  if (rest_a & 16) a++, rest_a &= 15;
  rest_b += part_b;
  if (rest_b & 16) b++, rest_b &= 15;
  OCR1A = a;
  OCR1B = b;
  if (++beat == PERIODS_PER_MS) beat = 0, ticks++;
}

void board_drive(int16_t duty) {
  uint16_t a = HALF + (duty >> 1) + (duty & 1), b = HALF - (duty >> 1);
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    whole_a = a >> 4, part_a = a & 15;
    whole_b = b >> 4, part_b = b & 15;
  }
  PORTB |= ENABLE;
}

void board_off(void) {
  PORTB &= ~ENABLE;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    whole_a = whole_b = HALF >> 4;
    part_a = part_b = 0;
  }
}

/* ---- converter: the current every other time ---- */

static const uint8_t order[8] = {CURRENT, PLATE, CURRENT, SINK, CURRENT, FLUX, CURRENT, GUARD};
static const uint8_t pin[INPUTS] = {3, 0, 1, 2, 4};
static volatile struct sum sums[INPUTS];
static uint8_t slot;

ISR(ADC_vect) {
  uint16_t value = ADC; /* of the input that ADMUX still names */
  volatile struct sum *sum = &sums[order[slot]];
  sum->total += value;
  sum->count++;
  slot = (slot + 1) & 7;
  ADMUX = _BV(REFS0) | pin[order[slot]];
  ADCSRA |= _BV(ADSC);
}

struct sum board_take(uint8_t input) {
  struct sum found;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    found.total = sums[input].total, found.count = sums[input].count;
    sums[input].total = 0, sums[input].count = 0;
  }
  return found;
}

/* ---- serial port ---- */

static volatile char heard[64], said[128];
static volatile uint8_t heard_in, heard_out, said_in, said_out;

ISR(USART_RX_vect) {
  uint8_t bad = UCSR0A & (_BV(FE0) | _BV(DOR0)), next = (heard_in + 1) & 63;
  char byte = UDR0;
  if (next == heard_out) return; /* no room: the line's check sum will tell */
  heard[heard_in] = bad ? 0 : byte;
  heard_in = next;
}

ISR(USART_UDRE_vect) {
  if (said_out == said_in) {
    UCSR0B &= ~_BV(UDRIE0);
    return;
  }
  UDR0 = said[said_out];
  said_out = (said_out + 1) & 127;
}

int16_t board_get(void) {
  if (heard_in == heard_out) return -1;
  char byte = heard[heard_out];
  heard_out = (heard_out + 1) & 63;
  return (uint8_t)byte;
}

void board_put(char byte) {
  uint8_t next = (said_in + 1) & 127;
  if (next == said_out) return; /* nobody has taken what was said before: this is lost, and its check sum tells */
  said[said_in] = byte;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    said_in = next;
    UCSR0B |= _BV(UDRIE0);
  }
}

/* ---- the rest ---- */

void board_begin(void) {
  cli();
  PORTB &= ~(ENABLE | _BV(PORTB1) | _BV(PORTB2));
  DDRB |= ENABLE | _BV(DDB1) | _BV(DDB2);
  TCCR1A = TCCR1B = 0;
  TCNT1 = 0;
  ICR1 = TOP;
  OCR1A = OCR1B = HALF >> 4;
  TCCR1A = _BV(COM1A1) | _BV(COM1B1) | _BV(WGM11);
  TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);
  TIMSK1 = _BV(TOIE1);
  DIDR0 = 0x1F; /* no digital buffers at the analog inputs */
  slot = 0;
  ADMUX = _BV(REFS0) | pin[order[0]];
  ADCSRB = 0;
  ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0); /* 9600 a second */
  UCSR0A = _BV(U2X0); /* before the divider: the simulator reckons its time a byte as that is written */
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UBRR0 = (F_CPU / 4 / BAUD - 1) / 2;
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
  set_sleep_mode(SLEEP_MODE_IDLE);
  sei();
  wdt_enable(WDTO_60MS);
}

uint8_t board_turn(void) {
  static uint8_t seen;
  if (seen == ticks) {
    sleep_mode(); /* until the next interrupt, 50 us at most */
    if (seen == ticks) return 0;
  }
  seen++;
  return 1;
}

void board_alive(void) { wdt_reset(); }

uint8_t board_kept(void) { return eeprom_read_byte((const uint8_t *)0); }

void board_keep(uint8_t value) { eeprom_update_byte((uint8_t *)0, value); }
