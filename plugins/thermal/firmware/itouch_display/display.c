/* Once a millisecond: readings, protection and current; in between: the host. */
#include "display.h"

#include "board.h"

void display_begin(void) {
  board_begin();
  control_begin();
}

void display_turn(void) {
  uint8_t begun = board_turn();
  protocol_turn();
  if (begun) control_turn();
}
