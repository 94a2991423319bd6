"""Web pages, safe on a vessel's network: one front for metrics, dashboard and consoles.

`connections` bounds what visitors can take of the process, whoever they are; `gatekeeper` refuses
requests that other pages make through a browser; `front` serves an application behind both.
uvicorn and h11 do the rest: the extras `metrics` and `console`.
"""
