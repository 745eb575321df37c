"""Reading Mitsuba's XML, of version 3 and of the old ones."""
