"""The carried surface of one probe in a tick: what is below the finger, who renders it, and what each of them does."""
