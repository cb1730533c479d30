"""The console in a browser: a small web server that starts one app process for each tab.

Files:

- `server`: The web server of the tablet, on textual-serve
- `tab`: One tab's console: a process, with all that it starts a group of its own
"""

# in a tab's environment: the server's process, whose end is the tab's own
SERVER_VARIABLE = "TOPDRESS_SERVER"
# and from where it was opened: wrong keys are counted by that
ADDRESS_VARIABLE = "TOPDRESS_ADDRESS"
