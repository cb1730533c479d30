"""The console in a browser: a small web server that starts one app process for each tab."""

# in a tab's environment: the server's process, whose end is the tab's own
SERVER = "TOPDRESS_SERVER"
# and from where it was opened: wrong keys are counted by that
ADDRESS = "TOPDRESS_ADDRESS"
