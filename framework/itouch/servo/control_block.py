"""The control words at the head of a session's shared memory: heartbeats, phase, places of its other parts.

All words are 64-bit integers at fixed places, written by one process each, so that reading and writing one is atomic.
Times are nanoseconds of the monotonic clock, which all processes of a machine share.
"""

from __future__ import annotations

from typing import Final

#: What the memory begins with, and the version of this layout.
MAGIC_VALUE: Final = 0x4F53454E_48435549 & 0x7FFF_FFFF_FFFF_FFFF
FORMAT_VALUE: Final = 1

MAGIC: Final = 0
FORMAT: Final = 1
#: Whole size of the memory [bytes]; 0 until the layout is known.
SIZE: Final = 2
META_AT: Final = 3
META_SIZE: Final = 4
TIMING_AT: Final = 5
TIMING_SIZE: Final = 6
RING_AT: Final = 7
SLOTS: Final = 8
SLOT_SIZE: Final = 9
STATE_SIZE: Final = 10
#: Whether slots carry a sum, because this processor may reorder memory accesses.
SUMMED: Final = 11

#: What the servo process is doing, its id, when it last lived, and the sequence number of the newest State.
PHASE: Final = 16
SERVO: Final = 17
BEAT: Final = 18
HEAD: Final = 19
#: Whether silence of the servo means danger: devices obey, and the guardian must act.
ARMED: Final = 20
#: The process that launched the session.
OWNER: Final = 21
#: The guardian, and when it last lived.
GUARDIAN: Final = 22
GUARDIAN_BEAT: Final = 23
#: Set by anyone who wants the session to end: the devices are made safe first.
STOP: Final = 24
#: Somebody holds the dead-man's switch until this time: one word that needs no place among the holders.
HELD_UNTIL: Final = 25
#: How many commands were put into the box, and how many were taken out.
ASKED: Final = 26
TAKEN: Final = 27
#: Sequence numbers round the copy of Timing.
TIMING_BEGIN: Final = 28
TIMING_END: Final = 29
#: What is not kept any more of the session: a sum of 1 for the recording and 2 for saving.
LOST: Final = 30
#: Devices that the loop could not give their last command, a bit each by their place in the scene.
UNSENT: Final = 31
#: Who may hold the dead-man's switch: for each a mark of its owner, and until when it is held.
HOLDERS: Final = 32
MOST_HOLDERS: Final = 16

WORDS: Final = 64

#: The box of commands: where it begins, how many commands it holds, and how long [bytes] one may be.
BOX_AT: Final = 4096
BOX_SLOTS: Final = 32
BOX_SLOT_SIZE: Final = 1024
#: Size of what exists before the layout of State is known [bytes].
HEAD_SIZE: Final = BOX_AT + BOX_SLOTS * BOX_SLOT_SIZE

#: Phases of a session, in order.
BUILDING, READY, RUNNING, ENDING, ENDED = range(5)
PHASES: Final = ("building", "ready", "running", "ending", "ended")
