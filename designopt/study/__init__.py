"""Studies as plug-ins: settings, runner, results, report, error against run time, stability."""
