"""The first configuration: what a live Zenoh network carries, written down for the user to edit.

Three steps, one module each:

- `survey`: listen for a while; topics with their rates, sizes, encodings and some payloads;
  services, if the router reports them;
- `inference`: from the values of some payloads to the fields of a type, with bounds that are wider
  than what was seen;
- `writing`: the file, with a comment wherever a person knows more than a few seconds of listening.

What fits no type goes as opaque bytes, and the comment has the reason. The file that comes
out is always valid, and accepts every payload that was seen.
"""
