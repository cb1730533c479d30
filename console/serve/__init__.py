"""The console in a browser: a small web server that starts one app process for each tab."""

SERVER = "TOPDRESS_SERVER"      # in a tab's environment: the server's process, whose end is the tab's own
ADDRESS = "TOPDRESS_ADDRESS"    # and from where it was opened: wrong keys are counted by that
