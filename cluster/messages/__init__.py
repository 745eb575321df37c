"""What master and slaves say to each other: the messages, how they are packed, and what is checked of them."""
