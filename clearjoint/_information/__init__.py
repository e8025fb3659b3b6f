"""Information that measurements contain about parameters: identifiability from planned sensors, and
the longest record that a fit by a single run can use."""
