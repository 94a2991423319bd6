"""`zacoustic sim campaign`: a scenario with varied parameters, on all cores or machines.

`spec` is the file, `paths` names values in it and in the files it refers to, `campaign` holds all
that decides a figure: its cells and runs. `running` is the work of a worker, `batches` groups runs
for workers, `carrying` executes them on `cluster`, and `rows` stores each result. `interval` and
`cells` summarise rows; `tables`, `plots`, `page` and `text` show the summary.
"""
