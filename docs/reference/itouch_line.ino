// itouch line protocol, version 1: an H-bridge, two thermistors and a flux sensor on an Arduino.
// Adapt the pins and the five functions below the line; the rest is the protocol.
#include <math.h>
#include <stdlib.h>
#include <string.h>

const unsigned long WATCHDOG_MS = 200;  // without an order for so long the current goes to zero
const float MOST_AMPS = 3.0;
char line[48];
byte used = 0;
float amps = 0;
unsigned long heard = 0;

byte sum(const char *text) {
  byte check = 0;
  while (*text) check ^= (byte)*text++;
  return check;
}

void say(const char *text) {
  char tail[4];
  snprintf(tail, sizeof tail, "*%02X", sum(text));
  Serial.print(text);
  Serial.println(tail);
}

void obey(char *text) {
  char *star = strrchr(text, '*');
  if (!star || strlen(star) != 3) return;  // the host will ask again
  byte given = (byte)strtoul(star + 1, NULL, 16);
  *star = 0;
  if (sum(text) != given) return;
  if (strcmp(text, "?") == 0) { say("N itouch-line 1 arduino"); return; }
  if (strncmp(text, "I ", 2) != 0) { say("E unknown command"); return; }
  float wanted = atof(text + 2);
  if (!(fabs(wanted) <= MOST_AMPS)) { say("E out of range"); return; }
  amps = wanted;
  heard = millis();
  drive(amps);
  char answer[64], number[5][12];
  float values[5] = {plate(), sink(), flux(), NAN, amps};
  for (byte i = 0; i < 5; i++) isnan(values[i]) ? strcpy(number[i], "nan") : dtostrf(values[i], 1, 4, number[i]);
  snprintf(answer, sizeof answer, "R %s %s %s %s %s", number[0], number[1], number[2], number[3], number[4]);
  say(answer);
}

void loop() {
  if (amps != 0 && millis() - heard > WATCHDOG_MS) drive(amps = 0);
  while (Serial.available()) {
    char byte_ = Serial.read();
    if (byte_ == '\r') continue;
    if (byte_ == '\n') { line[used] = 0; obey(line); used = 0; }
    else if (used < sizeof line - 1) line[used++] = byte_;
  }
}

// ---- yours from here on ---------------------------------------------------------------------------------------
const byte FORWARD_PWM = 9, REVERSE_PWM = 10, PLATE_PIN = A0, SINK_PIN = A1, FLUX_PIN = A2;

void setup() {
  Serial.begin(115200);
  pinMode(FORWARD_PWM, OUTPUT);
  pinMode(REVERSE_PWM, OUTPUT);
  drive(0);
}

void drive(float wanted) {  // measured at full duty: MOST_AMPS
  int duty = (int)(255 * fabs(wanted) / MOST_AMPS);
  analogWrite(FORWARD_PWM, wanted > 0 ? duty : 0);
  analogWrite(REVERSE_PWM, wanted < 0 ? duty : 0);
}

float thermistor(byte pin) {  // 10 kOhm, B = 3950 K, to ground, with 10 kOhm to the reference voltage
  float part = analogRead(pin) / 1023.0;
  float ohms = 10e3 * part / (1 - part);
  return 1 / (1 / 298.15 + log(ohms / 10e3) / 3950) - 273.15;
}

float plate() { return thermistor(PLATE_PIN); }
float sink() { return thermistor(SINK_PIN); }
float flux() { return (analogRead(FLUX_PIN) - 512) * 10.0; }  // W/m2 a count: from the sensor's sheet and your amplifier
