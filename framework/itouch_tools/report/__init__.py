"""What people read of a session: its page, one file that is opened in a browser, and the tables of the terminal."""
