"""Keys of a fleet and the cipher that uses them; needs the extra `secure`.

- `spec`: the section of the configuration;
- `keyring`: makes the cipher and the life records from it, `open_keyring`;
- `keys`: the secret of a fleet in a file, and the keys derived from it;
- `identities`: the alternative, one key pair for each node;
- `ccm`: AES-128-CCM behind the interface of `zacoustic.core.wire.seal`;
- `lives`: the number of each start, which no other start may have.
"""
