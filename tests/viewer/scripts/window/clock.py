"""time runs with the host's clock."""

from prepared import session, turn

before = session.seconds
turn(10, 0.05)
assert abs(session.seconds - before - 0.5) < 0.003, session.seconds - before
