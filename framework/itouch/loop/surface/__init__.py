"""The carried surface of one probe in a tick: what is below the finger, who renders it, and what arm and plate do."""
