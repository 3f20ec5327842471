/* The line protocol, version 2: a command line, an answer line, each with a CRC-16 (0x1021, begins with 0xFFFF).

   ?           N itouch-line 2 NAME amps= plate= sink= silence= reset= cut=
   I NR AMPS   R NR PLATE SINK FLUX SKIN AMPS STATE
   C           N ..., if what had cut it off is gone                                   E WORDS refuses */
#include <math.h>
#include <string.h>

#include "board.h"
#include "config.h"
#include "display.h"

static uint16_t sum;
static uint8_t greeted;

static uint16_t fed(uint16_t crc, uint8_t byte) {
  crc ^= (uint16_t)byte << 8;
  for (uint8_t bit = 0; bit < 8; bit++) crc = crc & 0x8000 ? (uint16_t)(crc << 1) ^ 0x1021 : (uint16_t)(crc << 1);
  return crc;
}

/* ---- what is said ---- */

static void put(char byte) {
  sum = fed(sum, (uint8_t)byte);
  board_put(byte);
}

static void text(const char *words) {
  while (*words) put(*words++);
}

static void whole(uint32_t value, uint8_t digits) {
  char reversed[10];
  uint8_t n = 0;
  do reversed[n++] = '0' + value % 10, value /= 10;
  while (value || n < digits);
  while (n) put(reversed[--n]);
}

/* A number with so many digits after the point. */
static void number(float value, uint8_t digits) {
  if (isnan(value)) {
    text("nan");
    return;
  }
  uint32_t scale = 1;
  for (uint8_t i = 0; i < digits; i++) scale *= 10;
  if (value < 0.0f) put('-'), value = -value;
  uint32_t all = (uint32_t)(value * scale + 0.5f);
  whole(all / scale, 1);
  put('.');
  whole(all % scale, digits);
}

static void begin(char kind) {
  sum = 0xFFFF;
  put(kind);
}

static void end(void) {
  uint16_t crc = sum;
  board_put('*');
  for (int8_t shift = 12; shift >= 0; shift -= 4) board_put("0123456789ABCDEF"[crc >> shift & 15]);
  board_put('\n');
}

static void refuse(const char *why) {
  begin('E');
  put(' ');
  text(why);
  end();
}

static void greet(void) {
  greeted = 1;
  begin('N');
  text(" itouch-line 2 " NAME " amps=");
  number(MOST_A, 3);
  text(" plate=");
  number(PLATE_COLD_C, 1);
  put(':');
  number(PLATE_HOT_C, 1);
  text(" sink=");
  number(SINK_HOT_C, 1);
  text(" silence=");
  number(SILENCE_MS * 0.001f, 3);
  text(" reset=");
  text(board_started());
  text(" cut=");
  text(cut_names[cut]);
  end();
}

static void word(float value, uint8_t digits) {
  put(' ');
  number(value, digits);
}

static void report(uint8_t nr) {
  begin('R');
  put(' ');
  whole(nr, 1);
  word(now.plate, 3);
  word(now.sink, 3);
  word(sensors_flux(), 1);
  word(NAN, 1); /* nothing looks at the skin */
  word(now.current, 5);
  put(' ');
  text(cut != FINE ? cut_names[cut] : folded ? "held-back" : "ok");
  end();
}

/* ---- what is heard ---- */

static uint8_t hex(char digit) {
  if (digit >= '0' && digit <= '9') return digit - '0';
  if (digit >= 'A' && digit <= 'F') return digit - 'A' + 10;
  return 255;
}

/* Take the check sum off; tell whether it was right. */
static uint8_t sealed(char *line, uint8_t used) {
  if (strcmp(line, "?*3F") == 0) { /* as version 1 asks */
    line[1] = 0;
    return 1;
  }
  if (used < 6 || line[used - 5] != '*') return 0;
  uint16_t crc = 0xFFFF, given = 0;
  for (uint8_t i = 0; i < used - 5; i++) crc = fed(crc, (uint8_t)line[i]);
  for (uint8_t i = used - 4; i < used; i++) {
    uint8_t digit = hex(line[i]);
    if (digit > 15) return 0;
    given = given << 4 | digit;
  }
  line[used - 5] = 0;
  return crc == given;
}

/* Read up to so many digits; tell how many. */
static uint8_t digits(const char **at, uint8_t most, uint32_t *value) {
  uint8_t n = 0;
  while (n < most && **at >= '0' && **at <= '9') *value = *value * 10 + (uint8_t)(*(*at)++ - '0'), n++;
  return n;
}

/* Read a number of at most four digits before the point and five after it, and nothing else. */
static uint8_t amps(const char *at, float *value) {
  uint8_t minus = *at == '-';
  uint32_t before = 0, after = 0;
  if (minus) at++;
  if (!digits(&at, 4, &before)) return 0;
  float scale = 1.0f;
  if (*at == '.') {
    at++;
    uint8_t n = digits(&at, 5, &after);
    if (!n) return 0;
    while (n--) scale *= 10.0f;
  }
  *value = before + after / scale;
  if (minus) *value = -*value;
  return *at == 0;
}

static void order(const char *at) {
  uint32_t nr = 0;
  float value;
  if (!digits(&at, 3, &nr) || nr > 255 || *at++ != ' ' || !amps(at, &value)) {
    refuse("not a number");
  } else if (!(fabsf(value) <= MOST_A)) {
    refuse("out of range");
  } else if (!greeted) {
    refuse("restarted: greet first");
  } else {
    wanted = cut == FINE ? value : 0.0f;
    control_heard();
    report((uint8_t)nr);
  }
}

static void obey(char *line, uint8_t used) {
  if (!sealed(line, used) || !sensors_zeroed()) return; /* the host will ask again */
  if (strcmp(line, "?") == 0) {
    greet();
  } else if (strcmp(line, "C") == 0) {
    if (control_release()) greet();
    else refuse("what has cut it off is not over");
  } else if (line[0] == 'I' && line[1] == ' ') {
    order(line + 2);
  } else {
    refuse("unknown command");
  }
}

void protocol_turn(void) {
  static char line[40];
  static uint8_t used, spoilt;
  int16_t byte;
  while ((byte = board_get()) >= 0) {
    if (byte == '\n') {
      line[used] = 0;
      if (!spoilt) obey(line, used);
      used = spoilt = 0;
    } else if (byte != '\r') {
      if (used >= sizeof line - 1 || byte < ' ' || byte > '~') spoilt = 1;
      else line[used++] = (char)byte;
    }
  }
}
