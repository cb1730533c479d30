"""Serves the console to browsers: a small web server that starts one app process per tab.

Files:

- `server`: Runs the tablet's web server on textual-serve
- `tab_console`: Runs one tab's console as a process in a process group of its own
"""

# Variable in a tab's environment with the process id of the server, whose end is the end of the
# tab.
SERVER_VARIABLE = "TOPDRESS_SERVER"
# Variable with the address from which the tab was opened; wrong keys are counted by address.
ADDRESS_VARIABLE = "TOPDRESS_ADDRESS"
