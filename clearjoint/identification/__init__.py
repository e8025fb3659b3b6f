"""Parameters from measurements: what data can tell, how long a run can be fitted, and fits."""
