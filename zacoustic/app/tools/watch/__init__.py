"""Watching gateways from anywhere on their Zenoh network: one model, several ways to show it.

Every gateway publishes its health in documents under ``@acoustic/ADDRESS/``
(`zacoustic.zenoh.gateway.status.health`): counters, instants and mean times, which stay true while
nothing happens. `Watch` subscribes to them, `Board` keeps the newest and makes of them what people
want to read, `GatewayView`: ages, rates, shares, now. The rest shows views::

    Zenoh ──► Watch ──► Board ──► GatewayView ──┬─► terminal   zacoustic monitor
                                                ├─► page       zacoustic dashboard
                                                ├─► text       zacoustic monitor --once, topics
                                                └─► JSON       --json

Nothing of it takes airtime.
"""
