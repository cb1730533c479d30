"""Validates by prediction everything that a diagnosis reports or a machine file adopts.

Named causes are judged by evidence; a machine file is judged by running that file. Its prediction
of the log is compared with (a) the unchanged file, (b) the named causes alone, (c) a plain rival:
curve of the command, lag, dead time and straight lines over the recorded variables, by least
squares (`plain_rival`). The comparison uses the error on blocks to which the numbers were not
fitted (`block_errors`), and on the whole log from its own start. The package uses a log and machine
files; it does not depend on how the causes were found.

Files:

- `block_errors`: Calculates the error of a machine file on blocks of a log to which its numbers
- `log_prediction`: Predicts a log with any machine file, on the judged rows
- `plain_rival`: Fits the plain rival: a least-squares model without knowledge of effects
- `predictive_validation`: Validates a diagnosis by prediction
"""
