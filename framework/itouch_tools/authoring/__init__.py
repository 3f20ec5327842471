"""Help with writing scenes: notes on what is odd, fixes of misspellings, the schema for editors, the reference."""
