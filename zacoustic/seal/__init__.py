"""The keys of a fleet and the cipher that uses them: the extra `secure`.

- `spec`: what a configuration says of them;
- `keyring`: from there to a cipher and the lives, `open_keyring`;
- `keys`: a fleet's secret in a file, and what is derived from it;
- `ccm`: AES-128-CCM, as `zacoustic.core.wire.seal` asks for it;
- `lives`: the number of this start, which no other start may have.
"""
