"""The first configuration: the streams of a live Zenoh network, for the user to edit.

Three steps, one module each:

- `survey`: listens for a while; topics with their rates, sizes, encodings and some payloads;
  services, if the router reports them;
- `inference`: from the values of some payloads to the fields of a type, with wider bounds than the
  observed values;
- `writing`: the file, with a comment wherever the user knows more than a few seconds of listening.

A payload that fits no type becomes opaque bytes, and the comment has the reason. The resulting file
is always valid, and accepts every observed payload.
"""
