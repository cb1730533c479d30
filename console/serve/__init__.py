"""The console in a browser: a small web server that starts one app process for each tab."""
