//! Colours that colour-blind readers can tell apart, and shades.

use kestrel_draw::drawing::{Colour, Dashed, Pen};

pub(super) const INK: Colour = Colour([0x1f, 0x29, 0x33]);
pub(super) const MUTED: Colour = Colour([0x5b, 0x66, 0x73]);
pub(super) const GRID: Colour = Colour([0xe4, 0xe8, 0xee]);
pub(super) const PAPER: Colour = Colour([0xff, 0xff, 0xff]);

/// Okabe and Ito 2008 without their yellow, which cannot be read on white.
const COLOURS: [Colour; 7] = [
    Colour([0x00, 0x72, 0xb2]),
    Colour([0xd5, 0x5e, 0x00]),
    Colour([0x00, 0x9e, 0x73]),
    Colour([0xcc, 0x79, 0xa7]),
    Colour([0xe6, 0x9f, 0x00]),
    Colour([0x56, 0xb4, 0xe9]),
    Colour([0x1f, 0x29, 0x33]),
];

/// Colour of a method; they recur after seven.
pub(super) fn colour(method: usize) -> Colour {
    COLOURS[method % COLOURS.len()]
}

/// Line of a method: solid for the first seven, dashed for the next, then the same at half the width.
pub(super) fn pen(method: usize, width: f64) -> Pen {
    let dashed = if (method / COLOURS.len()).is_multiple_of(2) { Dashed::Solid } else { Dashed::Dashes };
    Pen { colour: colour(method), width: width / (1 + method / (2 * COLOURS.len())) as f64, dashed }
}

/// From white at 0 to dark blue at 1: one hue, told apart by lightness.
pub(super) fn shade(share: f64) -> Colour {
    let (light, dark) = ([0xf7, 0xfb, 0xff], [0x08, 0x45, 0x94]);
    let mix = |index: usize| {
        let (from, to): (u8, u8) = (light[index], dark[index]);
        (f64::from(from) + share.clamp(0.0, 1.0) * (f64::from(to) - f64::from(from))).round() as u8
    };
    Colour([mix(0), mix(1), mix(2)])
}

/// Readable on [`shade`].
pub(super) fn on_shade(share: f64) -> Colour {
    if share > 0.55 { PAPER } else { INK }
}
