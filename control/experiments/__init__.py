"""Plans the next measurement: design of experiments by the readings that each rival hypothesis
predicts.

`manoeuvres` are short runs of the machine at work, `list_bench_tests` returns tests in the yard.
Both are an `Experiment`, and `experiment.choose_experiments` selects those that separate rivals
soonest. `setting_levels` are their settings.

Files:

- `bench_tests`: Which cheap tests can a farm make in its yard
- `experiment`: Which experiments separate rival hypotheses soonest?
- `manoeuvres`: Which short runs cost little, and which log would each leave of a given machine
- `setting_levels`: At which settings are experiments made?
"""
