"""What should be measured next? Design of experiments, by the readings that each rival
hypothesis predicts.

`manoeuvres` are short runs of the machine at work, `list_bench_tests` what is tried in the yard;
both are an `Experiment`, and `experiment.chosen` picks those that tell rivals apart soonest.
`levels` are the settings that they go through.

Files:

- `bench_tests`: Which cheap tests can a farm make in its yard
- `experiment`: Which experiments separate rival hypotheses soonest?
- `levels`: At which settings are experiments made?
- `manoeuvres`: Which short runs cost little, and which log would each leave of a given machine
"""
