"""Nothing is said or written that prediction does not bear out.

Names are judged by evidence; what a machine file takes up is judged by running that very file.
It is held on the log against (a) the file as it was, (b) the named causes alone, (c) a plain
rival: curve of the command, lag, dead time and straight lines over the recorded variables, by
least squares (`rival`). What is compared is the error on blocks that the numbers were not
fitted to (`blocks`), and on the whole log from its own start. The room knows a log and machine
files; how the causes were found it does not know.

Files:

- `blocks`: The error of a machine file on blocks of a log that its numbers were not fitted to
- `on_log`: A log as any machine file predicts it, on the rows that are judged
- `predictive_validation`: What prediction bears out of a diagnosis
- `rival`: The plain rival: what anybody would fit who knows no effects
"""
