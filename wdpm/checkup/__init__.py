"""What is wrong or risky in a scene (`wdpm check`)."""
