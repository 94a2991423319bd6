"""The first configuration: what a live Zenoh network carries, written down for the user to edit.

Three steps, one module each:

- `survey`: listen for a while; topics with their rates, sizes, encodings and some payloads;
  services where the router tells;
- `inference`: from the values of some payloads to the fields of a type, with bounds that are wider
  than what was seen;
- `writing`: the file, with a comment wherever a person knows more than a few seconds of listening.

What cannot be put into a type goes as opaque bytes, and the comment says why. The file that comes
out is always valid, and accepts every payload that was seen.
"""
