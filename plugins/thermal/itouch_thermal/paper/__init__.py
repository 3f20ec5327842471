"""The paper's figures and claims, as the paper did them, with our own method beside."""
