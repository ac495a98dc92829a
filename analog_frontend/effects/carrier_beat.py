"""Image of the rebalance DAC at eight times its rate, demodulated by the ring diode: n_y += c w cos(2 pi F t), F = 8
Hz per ppm of carrier against master.

At 20 ppm the beat is 160 Hz, of which the demodulator passes little; near 0 ppm the scale factor wanders slowly.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="carrier_beat",
    port="cv_y",
    mechanism="tone",
    unit="V/V",
    source="the ring diode takes 8 MHz images 71 dB better than the baseband; value assumed",
    fingerprint="a tone in rate at the beat of the two clocks; it grows with the rebalance voltage, hence with rate",
)
IDS, LIMIT, EXAMPLE, SIGN = "E26", 0.01, 1e-06, 0
DOC = "DAC image at 8 MHz against the carrier: rebalance voltage in the sense C/V output at their beat"


def terms(value, device):
    return (f"cv_y = {value!r} cos({min(8.0 * abs(device.carrier_ppm - device.clock_ppm), 1000.0)!r}) w",)
