"""A small trial: the water, and the file of its fleet."""

CHANNEL = """{
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [800, 0, 10] } ],
  config: "fleet.json5", loss: { frame: 0.1 },
  traffic: [
    { node: 2, topic: "auv1/nav", every_s: 20, value: { depth: 4.2, mode: "survey" } },
    { node: 1, service: "auv1/arm", every_s: 100, value: { arm: true }, answer: { ok: true } },
    { node: 2, topic: "auv1/raw", every_s: 30, size_bytes: 10 } ] }"""
FLEET = """{ plugins: { acoustic: {
  address: 1, nodes: [ { address: 1, name: "shore" }, { address: 2, name: "auv1" } ],
  types: [
    { name: "Nav", fields: [
      { name: "depth", type: "float32", range: [0, 1000], step: 0.1, unit: "m" },
      { name: "mode", type: "enum", values: ["idle", "survey"] } ] },
    { name: "Arm", fields: [ { name: "arm", type: "bool" } ] },
    { name: "Armed", fields: [ { name: "ok", type: "bool" } ] } ],
  streams: [ { id: 10, topic: "auv1/nav", type: "Nav", stamp: "age", lifespan_s: 60 },
             { id: 11, topic: "auv1/raw" },
             { id: 20, service: "auv1/arm", request: "Arm", response: "Armed", server: 2 } ],
} } }"""
