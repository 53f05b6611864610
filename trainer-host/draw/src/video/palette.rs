//! The 255 colours that serve a video best.

use crate::picture::{Picture, Rgb};

/// Colours of a palette; one more index means that a pixel does not change.
const COLOURS: usize = 255;

/// Bits of each part of a colour that tell cells of colours apart.
const BITS: u32 = 5;

const CELLS: usize = 1 << (3 * BITS);

/// Colours, and which of them is nearest to each cell of colours.
#[derive(Clone, Debug)]
pub(super) struct Palette {
    colours: Vec<Rgb>,
    nearest: Vec<u8>,
}

/// Pixels whose colours are in one cell.
#[derive(Clone, Copy, Debug)]
struct Cell {
    count: f64,
    mean: [f64; 3],
}

/// Cells that share a colour of the palette.
#[derive(Debug)]
struct Group {
    cells: Vec<Cell>,
    mean: [f64; 3],
    /// Sum over its pixels of the squared distances from its mean, along each axis.
    errors: [f64; 3],
}

impl Palette {
    /// Divides the colours of the pictures where that takes away most of the squared error, until there are enough groups.
    pub(super) fn of<'a>(pictures: impl IntoIterator<Item = &'a Picture>) -> Self {
        let mut groups = vec![Group::of(cells(pictures))];
        while groups.len() < COLOURS {
            let error = |group: &Group| group.errors.into_iter().fold(0.0, f64::max);
            let worst =
                (0..groups.len()).max_by(|one, other| error(&groups[*one]).total_cmp(&error(&groups[*other])));
            let Some(worst) = worst.filter(|worst| error(&groups[*worst]) > 0.0) else { break };
            let halves = groups.swap_remove(worst).divided();
            groups.extend(halves);
        }
        let colours: Vec<Rgb> = groups.iter().map(|group| group.mean.map(|part| part.round() as u8)).collect();
        let nearest = (0..CELLS).map(|index| index_of_nearest(&colours, centre(index))).collect();
        let mut palette = Self { colours, nearest };
        palette.keep_own_cells(&groups);
        palette
    }

    /// Red, green, blue of each colour, and one for the index behind them.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.colours.iter().flatten().copied().chain([0; 3]).collect()
    }

    /// The index behind the colours.
    pub(super) fn unchanged(&self) -> u8 {
        self.colours.len() as u8
    }

    /// The picture in indices.
    pub(super) fn indices(&self, picture: &Picture) -> Vec<u8> {
        picture.pixels.iter().map(|pixel| self.nearest[cell(*pixel)]).collect()
    }

    /// A cell that occurs has the colour that is nearest to its mean, not to its centre.
    fn keep_own_cells(&mut self, groups: &[Group]) {
        for own in groups.iter().flat_map(|group| &group.cells) {
            let index = cell(own.mean.map(|part| part.round() as u8));
            self.nearest[index] = index_of_nearest(&self.colours, own.mean);
        }
    }
}

fn cell([red, green, blue]: Rgb) -> usize {
    let part = |value: u8| usize::from(value) >> (8 - BITS);
    part(red) << (2 * BITS) | part(green) << BITS | part(blue)
}

fn centre(cell: usize) -> [f64; 3] {
    let part = |shift: u32| ((cell >> shift & ((1 << BITS) - 1)) << (8 - BITS)) as f64 + 3.5;
    [part(2 * BITS), part(BITS), part(0)]
}

fn cells<'a>(pictures: impl IntoIterator<Item = &'a Picture>) -> Vec<Cell> {
    let mut sums = vec![(0_u64, [0_u64; 3]); CELLS];
    for pixel in pictures.into_iter().flat_map(|picture| &picture.pixels) {
        let (count, sum) = &mut sums[cell(*pixel)];
        *count += 1;
        sum.iter_mut().zip(pixel).for_each(|(sum, part)| *sum += u64::from(*part));
    }
    let occurring = sums.into_iter().filter(|(count, _)| *count > 0);
    occurring
        .map(|(count, sum)| Cell { count: count as f64, mean: sum.map(|sum| sum as f64 / count as f64) })
        .collect()
}

impl Group {
    fn of(cells: Vec<Cell>) -> Self {
        let count: f64 = cells.iter().map(|cell| cell.count).sum();
        let mean = [0, 1, 2]
            .map(|axis| cells.iter().map(|cell| cell.count * cell.mean[axis]).sum::<f64>() / count.max(1.0));
        let errors = [0, 1, 2]
            .map(|axis| cells.iter().map(|cell| cell.count * (cell.mean[axis] - mean[axis]).powi(2)).sum());
        Self { cells, mean, errors }
    }

    /// At its mean, along the axis with the greatest error; both halves have cells where that error is not nought.
    fn divided(self) -> [Self; 2] {
        let axis = (0..3).max_by(|one, other| self.errors[*one].total_cmp(&self.errors[*other])).unwrap_or(0);
        let (below, above) = self.cells.into_iter().partition(|cell| cell.mean[axis] < self.mean[axis]);
        [Self::of(below), Self::of(above)]
    }
}

fn index_of_nearest(colours: &[Rgb], wanted: [f64; 3]) -> u8 {
    let difference = |colour: &Rgb| -> f64 {
        // The eye sees green best.
        let weights = [2.0, 4.0, 3.0];
        (0..3).map(|axis| weights[axis] * (f64::from(colour[axis]) - wanted[axis]).powi(2)).sum()
    };
    let nearest =
        colours.iter().enumerate().min_by(|(_, one), (_, other)| difference(one).total_cmp(&difference(other)));
    nearest.map_or(0, |(index, _)| index as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixels: Vec<Rgb>) -> Picture {
        Picture { size: [pixels.len(), 1], pixels }
    }

    #[test]
    fn few_colours_stay_what_they_are() {
        let colours: Vec<Rgb> = (0..200).map(|index| [index as u8 / 10 * 10, index as u8 % 10 * 20, 7]).collect();
        let palette = Palette::of([&picture(colours.clone())]);
        let indices = palette.indices(&picture(colours.clone()));
        for (index, colour) in indices.iter().zip(&colours) {
            assert_eq!(palette.colours[usize::from(*index)], *colour);
        }
        assert_eq!(palette.bytes().len(), 3 * (usize::from(palette.unchanged()) + 1));
    }

    #[test]
    fn many_colours_become_neighbours() {
        let colours: Vec<Rgb> =
            (0..32_768).map(|index: u32| [index as u8, (index >> 5) as u8, (index >> 7) as u8]).collect();
        let palette = Palette::of([&picture(colours.clone())]);
        assert_eq!(palette.colours.len(), COLOURS);
        let far = palette.indices(&picture(colours.clone())).into_iter().zip(&colours).map(|(index, colour)| {
            let own = palette.colours[usize::from(index)];
            (0..3).map(|part| own[part].abs_diff(colour[part])).max().unwrap_or(0)
        });
        assert!(far.max() < Some(48));
    }

    #[test]
    fn a_palette_of_nothing_has_a_colour() {
        assert_eq!(Palette::of([]).colours.len(), 1);
    }
}
