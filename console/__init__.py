"""What people see: the control worker, the app, reports and the command line."""
