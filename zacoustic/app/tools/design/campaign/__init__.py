"""`zacoustic sim campaign`: a scenario with parameters swept, on all cores or machines there are.

`spec` is the file, `paths` names values in it and in what it refers to, `campaign` is everything
that decides a figure: its cells and runs. `running` is what a worker does, `batches` decides which
runs go to a worker together, `carrying` gets them done by `cluster`, and `rows` keeps each finished
one. `interval` and `cells` sum rows up; `tables`, `plots`, `page` and `text` show that.
"""
