"""The paper's figures and claims, reproduced with the paper's method, beside our own."""
