/* The display without the Arduino core. */
#include "display.h"

int main(void) {
  display_begin();
  for (;;) display_turn();
}
