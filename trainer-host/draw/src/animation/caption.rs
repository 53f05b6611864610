//! What is written into a picture: title, time, distance, speed and the key to the rotor colours.

use super::canvas::{Canvas, Paint};
use super::palette::{self, Colour};
use super::playback::Moment;
use super::{SIZE, STRIP, font};

/// Distance of the text from the picture's borders \[px\].
const MARGIN: usize = 16;

/// Width of one figure with its name \[px\].
const FIGURE_WIDTH: usize = 104;

/// Length and thickness of the key to the rotor colours \[px\].
const KEY: [usize; 2] = [72, 5];

/// A line of text and how it looks.
struct Text<'a> {
    letters: &'a str,
    /// Pixels that one pixel of the typeface becomes.
    scale: usize,
    colour: Colour,
}

/// Writes all captions of a moment.
pub(super) fn draw(title: &str, moment: &Moment, canvas: &mut Canvas) {
    heading(title).write([MARGIN, MARGIN], canvas);
    canvas.rectangle([0, SIZE[1] - STRIP, SIZE[0], STRIP], Paint::opaque(palette::PAPER));
    canvas.rectangle([0, SIZE[1] - STRIP, SIZE[0], 1], Paint::opaque(palette::GRID));
    let figures = figures(moment);
    let top = SIZE[1] - STRIP + 13;
    for (index, (name, value)) in figures.iter().enumerate() {
        let left = MARGIN + index * FIGURE_WIDTH;
        small(name).write([left, top], canvas);
        heading(value).write([left, top + 14], canvas);
    }
    draw_key([SIZE[0] - MARGIN - KEY[0], top], canvas);
}

/// The figures and their names: those of the drone, or what matters most about several.
fn figures(moment: &Moment) -> [(&'static str, String); 3] {
    let time = ("time", format!("{:.2} s", moment.elapsed_secs));
    if let [drone] = moment.drones[..] {
        let distance = ("to goal", format!("{:.2} m", drone.distance));
        return [time, distance, ("speed", format!("{:.2} m/s", drone.speed))];
    }
    let farthest = moment.drones.iter().map(|drone| drone.distance).fold(0.0, f32::max);
    let positions = moment.drones.iter().map(|drone| drone.frame.placement.position);
    let pairs = positions
        .clone()
        .enumerate()
        .flat_map(|(index, one)| positions.clone().take(index).map(move |other| (one - other).norm()));
    let closest = pairs.fold(f32::INFINITY, f32::min);
    [time, ("farthest to go", format!("{farthest:.2} m")), ("closest pair", format!("{closest:.2} m"))]
}

fn draw_key([left, top]: [usize; 2], canvas: &mut Canvas) {
    small("rotor thrust").write([left, top], canvas);
    for column in 0..KEY[0] {
        let colour = palette::thrust(column as f32 / (KEY[0] - 1) as f32);
        canvas.rectangle([left + column, top + 13, 1, KEY[1]], Paint::opaque(colour));
    }
    small("0").write([left, top + 22], canvas);
    let full = small("100 %");
    full.write([left + KEY[0] - full.width(), top + 22], canvas);
}

fn heading(letters: &str) -> Text<'_> {
    Text { letters, scale: 2, colour: palette::INK }
}

fn small(letters: &str) -> Text<'_> {
    Text { letters, scale: 1, colour: palette::MUTED }
}

impl Text<'_> {
    fn width(&self) -> usize {
        (self.letters.chars().count() * (font::WIDTH + font::GAP) - font::GAP) * self.scale
    }

    fn write(&self, [left, top]: [usize; 2], canvas: &mut Canvas) {
        for (index, letter) in self.letters.chars().enumerate() {
            let start = left + index * (font::WIDTH + font::GAP) * self.scale;
            self.write_letter(letter, [start, top], canvas);
        }
    }

    fn write_letter(&self, letter: char, [left, top]: [usize; 2], canvas: &mut Canvas) {
        for (row, bits) in font::glyph(letter).into_iter().enumerate() {
            for column in (0..font::WIDTH).filter(|column| bits >> (font::WIDTH - 1 - column) & 1 == 1) {
                let corner = [left + column * self.scale, top + row * self.scale];
                let area = [corner[0], corner[1], self.scale, self.scale];
                canvas.rectangle(area, Paint::opaque(self.colour));
            }
        }
    }
}
