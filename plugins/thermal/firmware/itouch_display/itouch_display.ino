// A thermal display for itouch-py: Peltier module, two or three thermistors, a flux film. Arduino Uno or Nano.
// Write your display's values into config.h. The wiring and the first power-on are in the documentation.
extern "C" {
#include "display.h"
}

void setup() { display_begin(); }

void loop() { display_turn(); }
