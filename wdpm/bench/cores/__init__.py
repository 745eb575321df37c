"""What more cores than a machine has would bring, reckoned from what a render does on those that it has."""
