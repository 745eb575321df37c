"""`wdpm doctor`: whether this machine has what wdpm needs, and what to do where it has not."""
