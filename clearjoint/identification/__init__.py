"""Parameters from measurements: what data can tell, and for how long a run can be fitted."""
