"""The page of a session for people: one file that is opened in a browser, and the tables of the terminal."""
