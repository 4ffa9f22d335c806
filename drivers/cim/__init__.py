"""Impedance telemetry of the implant (CIM) over UDP: decoders, the device, a relay and a replay (07 section 4).

The datagrams of the manufacturer's own telemetry are not public, so what arrives is decoded by an entry point of the
group ``rtctl.cim_decoders``; see :mod:`drivers.cim.sample` for what one has to be.
"""
