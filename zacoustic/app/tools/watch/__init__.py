"""Watches gateways from anywhere on their Zenoh network: one model, several displays.

Every gateway publishes its health in documents under ``@acoustic/ADDRESS/``
(`zacoustic.zenoh.gateway.status.health`): counters, instants and mean times, which stay true while
nothing happens. `Watch` subscribes to them. `Board` stores the newest and derives a `GatewayView`
for people: ages, rates, shares at present. The rest displays views::

    Zenoh ──► Watch ──► Board ──► GatewayView ──┬─► terminal   zacoustic monitor
                                                ├─► page       zacoustic dashboard
                                                ├─► text       zacoustic monitor --once, topics
                                                └─► JSON       --json

Watching uses no airtime.
"""
