//! Where everything is in a picture.

use crate::video::channel::LEGEND;

/// Around and between the parts \[px\].
pub(super) const MARGIN: usize = 8;

/// Heights of the title, of a part's name, and of the lines below \[px\].
pub(super) const TITLE: usize = 28;
pub(super) const NAME: usize = 12;
pub(super) const FOOT: usize = 46;

/// Share of the width that the small pictures have.
const SIDE: f64 = 0.32;

/// A part: `[left, top]` and `[width, height]` \[px\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Part {
    pub(super) corner: [usize; 2],
    pub(super) size: [usize; 2],
}

/// The large picture on the left; plan, on-board image and depth on the right, one below the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) main: Part,
    pub(super) plan: Part,
    pub(super) on_board: Part,
    pub(super) depth: Part,
}

impl Layout {
    /// For a picture of at least [`super::LEAST_SIZE`].
    pub(super) fn of([width, height]: [usize; 2]) -> Self {
        let side = (SIDE * width as f64) as usize;
        let main = Part { corner: [MARGIN, TITLE], size: [width - side - 3 * MARGIN, height - TITLE - FOOT] };
        let each = (main.size[1] - 3 * NAME - LEGEND - 2 * MARGIN) / 3;
        let left = width - side - MARGIN;
        let part = |index: usize| Part {
            corner: [left, TITLE + NAME + index * (each + NAME + MARGIN)],
            size: [side, each],
        };
        Self { main, plan: part(0), on_board: part(1), depth: part(2) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_in_the_picture_and_apart() {
        for size in [super::super::LEAST_SIZE, [960, 540], [333, 1000], [4000, 240]] {
            let Layout { main, plan, on_board, depth } = Layout::of(size);
            let parts = [main, plan, on_board, depth];
            for (index, part) in parts.iter().enumerate() {
                let end = |axis: usize| part.corner[axis] + part.size[axis];
                assert!(part.size.iter().all(|size| *size >= 10), "{size:?}: {part:?}");
                assert!(end(0) <= size[0] && end(1) <= size[1] - FOOT, "{size:?}: {part:?}");
                let beside = |other: &Part, axis: usize| {
                    end(axis) <= other.corner[axis] || other.corner[axis] + other.size[axis] <= part.corner[axis]
                };
                assert!(parts[..index].iter().all(|other| beside(other, 0) || beside(other, 1)), "{size:?}");
            }
        }
    }
}
