//! The few colours of the pictures.

use std::sync::LazyLock;

/// Red, green, blue in \[0, 255\].
pub(crate) type Colour = [f32; 3];

/// Behind everything.
pub(super) const PAPER: Colour = rgb(0xf7_f9fb);
/// The floor.
pub(super) const FLOOR: Colour = rgb(0xe9_edf2);
/// Lines on the floor.
pub(super) const GRID: Colour = rgb(0xcf_d7e1);
/// Where no light comes.
pub(super) const SHADOW: Colour = rgb(0x9a_a7b6);
/// Faces of solids across x, y and z.
pub(super) const FACES: [Colour; 3] = [rgb(0xb3_c0cf), rgb(0xc4_cfdb), rgb(0xd8_e0e9)];
/// Edges of solids.
pub(super) const EDGE: Colour = rgb(0x7f_90a4);
/// The goal.
pub(super) const GOAL: Colour = rgb(0x86_42d6);
/// Where drones have been: the first, the second and so on, then from the beginning.
const TRAILS: [Colour; 6] =
    [rgb(0xf0_7f2e), rgb(0x1c_8fd6), rgb(0x2e_a043), rgb(0xd6_3384), rgb(0xa6_7c00), rgb(0x00_99a8)];
/// The drone's frame, and figures.
pub(super) const INK: Colour = rgb(0x1f_2933);
/// The drone's nose.
pub(super) const NOSE: Colour = rgb(0xe5_3e4f);
/// Text beside figures.
pub(super) const MUTED: Colour = rgb(0x6b_7683);
/// Rotors from no thrust to full thrust.
const THRUST: [Colour; 4] = [rgb(0x4f_6df5), rgb(0x1f_b6b0), rgb(0xf2_b02e), rgb(0xe5_3e3e)];

/// Colours of large areas, which must come out as they are.
const DRAWN: [Colour; 6] = [PAPER, FLOOR, GRID, FACES[0], FACES[1], FACES[2]];

/// Steps in which a colour of the foreground fades into one of the background.
const FADES: usize = 4;

/// Steps in which the trails of all drones but the first fade.
const TRAIL_FADES: usize = 2;

/// Steps from ink to paper.
const GREYS: usize = 12;

/// Steps of the thrust colours.
const ROTORS: usize = 11;

/// Index of the colour that leaves a pixel as it was in the picture before: 7 bits, for short codes.
pub(super) const UNCHANGED: u8 = 127;

/// Colour of the trail of a drone, counted from zero.
pub(crate) fn trail(drone: usize) -> Colour {
    TRAILS[drone % TRAILS.len()]
}

/// Colour of a rotor at a share of its full thrust in \[0, 1\].
pub(super) fn thrust(share: f32) -> Colour {
    let place = share.clamp(0.0, 1.0) * (THRUST.len() - 1) as f32;
    let below = (place as usize).min(THRUST.len() - 2);
    mix(THRUST[below], THRUST[below + 1], place - below as f32)
}

/// From one colour towards another, by a share in \[0, 1\].
pub(super) fn mix(from: Colour, to: Colour, share: f32) -> Colour {
    std::array::from_fn(|channel| from[channel] + share * (to[channel] - from[channel]))
}

/// Index of the most similar colour of the palette.
pub(super) fn nearest(colour: Colour) -> u8 {
    PALETTE.nearest[cell(colour)]
}

/// The palette as GIF wants it: red, green, blue of each colour.
pub(super) fn bytes() -> Vec<u8> {
    PALETTE.colours.iter().flatten().copied().collect()
}

/// Index among the 64³ colours that the palette is asked for.
fn cell(colour: Colour) -> usize {
    let [red, green, blue] = colour.map(|channel| (channel.clamp(0.0, 255.0) as usize) >> 2);
    red << 12 | green << 6 | blue
}

const fn rgb(code: u32) -> Colour {
    [(code >> 16) as f32, (code >> 8 & 0xff) as f32, (code & 0xff) as f32]
}

static PALETTE: LazyLock<Palette> = LazyLock::new(Palette::new);

struct Palette {
    colours: Vec<[u8; 3]>,
    /// Index of the most similar colour of each of 64³ colours.
    nearest: Vec<u8>,
}

impl Palette {
    fn new() -> Self {
        let mut colours: Vec<[u8; 3]> =
            all_colours().iter().map(|colour| colour.map(|channel| (channel + 0.5) as u8)).collect();
        colours.sort_unstable();
        colours.dedup();
        assert!(colours.len() <= usize::from(UNCHANGED), "{} colours do not fit", colours.len());
        let nearest_to_centre = |cell: usize| {
            let centre = [cell >> 12, cell >> 6 & 63, cell & 63].map(|channel| 4 * channel as i32 + 2);
            index_of_nearest(&colours, centre)
        };
        let mut nearest: Vec<u8> = (0..64 * 64 * 64).map(nearest_to_centre).collect();
        for exact in DRAWN {
            let own = exact.map(|channel| channel as i32);
            nearest[cell(exact)] = index_of_nearest(&colours, own);
        }
        Self { colours, nearest }
    }
}

fn index_of_nearest(colours: &[[u8; 3]], wanted: [i32; 3]) -> u8 {
    let difference = |colour: &[u8; 3]| {
        let [red, green, blue] = std::array::from_fn(|channel| i32::from(colour[channel]) - wanted[channel]);
        2 * red * red + 4 * green * green + 3 * blue * blue // the eye sees green best
    };
    let nearest = colours.iter().enumerate().min_by_key(|(_, colour)| difference(colour));
    nearest.map_or(0, |(index, _)| index as u8)
}

/// The colours that are drawn, and those between them that soft edges and glass make.
fn all_colours() -> Vec<Colour> {
    let mut colours = Vec::from(DRAWN);
    colours.extend([mix(PAPER, FLOOR, 0.5), mix(PAPER, GRID, 0.5), mix(FLOOR, GRID, 0.5)]);
    colours.extend(ramp::<GREYS>(INK, PAPER));
    for background in [FLOOR, FACES[1]] {
        colours.extend([GOAL, TRAILS[0], NOSE, EDGE].iter().flat_map(|&colour| ramp::<FADES>(colour, background)));
    }
    colours.extend(TRAILS[1..].iter().flat_map(|&trail| ramp::<TRAIL_FADES>(trail, FLOOR)));
    for rotor in (0..ROTORS).map(|step| thrust(step as f32 / (ROTORS - 1) as f32)) {
        colours.extend(ramp::<FADES>(rotor, FLOOR));
        colours.push(mix(INK, rotor, 0.5));
        colours.push(mix(mix(FLOOR, GOAL, 0.25), rotor, 0.75));
    }
    colours
}

/// Evenly from one colour towards another, which is not among them.
fn ramp<const STEPS: usize>(from: Colour, to: Colour) -> [Colour; STEPS] {
    std::array::from_fn(|step| mix(from, to, step as f32 / STEPS as f32))
}
