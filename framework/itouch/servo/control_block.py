"""The control words at the head of a session's shared memory: heartbeats, phase, offsets of its other parts.

All words are aligned 64-bit integers at fixed places, each written by one process, so that reading and writing one is
atomic.  Times are nanoseconds of the monotonic clock, which all processes of a machine share.
"""

from __future__ import annotations

from typing import Final

#: The first word of the memory, and the version of this layout.
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
#: Whether slots carry a checksum, because this processor may reorder memory accesses.
SUMMED: Final = 11

#: Phase of the servo process, its id, its last heartbeat, and the sequence number of the newest State.
PHASE: Final = 16
SERVO: Final = 17
BEAT: Final = 18
HEAD: Final = 19
#: Whether silence of the servo process means danger: devices obey it, and the guardian must act.
ARMED: Final = 20
#: The id of the process that launched the session.
OWNER: Final = 21
#: The guardian's process id, and its last heartbeat.
GUARDIAN: Final = 22
GUARDIAN_BEAT: Final = 23
#: Set by anyone who wants the session to end: the devices are made safe first.
STOP: Final = 24
#: Somebody holds the dead-man's switch until this time: a word for a holder without a place of its own.
HELD_UNTIL: Final = 25
#: How many commands were put into the queue, and how many were taken out.
ASKED: Final = 26
TAKEN: Final = 27
#: Sequence numbers before and after the copy of Timing.
TIMING_BEGIN: Final = 28
TIMING_END: Final = 29
#: Which data of the session are no longer kept: the sum of 1 for the recording and 2 for saving.
LOST: Final = 30
#: Devices to which the loop could not write their last command, a bit each, by their place in the scene.
UNSENT: Final = 31
#: The holders of the dead-man's switch: for each a token of its owner, and until when it is held.
HOLDERS: Final = 32
MOST_HOLDERS: Final = 16

WORDS: Final = 64

#: The command queue: its offset, how many commands it holds, and how long [bytes] one may be.
BOX_AT: Final = 4096
BOX_SLOTS: Final = 32
BOX_SLOT_SIZE: Final = 1024
#: Size of the part that exists before the layout of State is known [bytes].
HEAD_SIZE: Final = BOX_AT + BOX_SLOTS * BOX_SLOT_SIZE

#: Phases of a session, in order.
BUILDING, READY, RUNNING, ENDING, ENDED = range(5)
PHASES: Final = ("building", "ready", "running", "ending", "ended")
