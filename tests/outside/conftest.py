"""Distributions of their own are installed and tested by tests of this project, not collected with them."""

collect_ignore_glob = ["*"]
