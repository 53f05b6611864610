//! The view from above alone, to lay something over it.

use nalgebra::Vector3;

use super::outline::Direction;
use super::subject::Subject;
use super::view::{Detail, Frame, Views};
use crate::drawing::{Colour, Drawing, Mark, Pen};
use crate::picture::Picture;

/// A drone on the plan.
#[derive(Clone, Debug)]
pub(crate) struct Flown {
    /// From where it started to where it is \[m, world\].
    pub(crate) way: Vec<Vector3<f64>>,
    /// Where its nose points, world.
    pub(crate) nose: Vector3<f64>,
    pub(crate) colour: Colour,
}

/// A small plan and where its points are.
#[derive(Clone, Debug)]
pub(crate) struct Above {
    frame: Frame,
    plan: Picture,
}

impl Above {
    /// As large as `size` \[px\] allows, in the middle of it.
    pub(crate) fn fitting(subject: &Subject, size: [usize; 2]) -> Self {
        let [width, height] = size.map(|pixels| pixels as f64);
        let views = Views::fitting(subject, [width, height]);
        let frame = views.frame(Direction::Above, [0.5 * (width - views.width()), 0.5 * (height - views.depth())]);
        let mut drawing = Drawing::new(width, height);
        frame.draw(&mut drawing, subject, Detail::Sheet);
        Self { frame, plan: drawing.over(&Picture::new(size, [255; 3])) }
    }

    /// The plan with drones and their ways.
    pub(crate) fn with(&self, drones: &[Flown]) -> Picture {
        let [width, height] = self.plan.size.map(|pixels| pixels as f64);
        let mut drawing = Drawing::new(width, height);
        let place = |point: &Vector3<f64>| self.frame.place(Direction::Above.project(*point));
        for Flown { way, nose, colour } in drones {
            let points: Vec<[f64; 2]> = way.iter().map(place).collect();
            let Some(last) = points.last().copied() else { continue };
            drawing.path(points, Pen::solid(*colour, 1.5));
            drawing.marks.push(head(last, [nose.x, -nose.y], *colour));
        }
        drawing.over(&self.plan)
    }
}

/// An arrow head that points along `nose`, a direction on paper.
fn head([x, y]: [f64; 2], nose: [f64; 2], colour: Colour) -> Mark {
    let length = (nose[0] * nose[0] + nose[1] * nose[1]).sqrt().max(1e-6);
    let [along, across] = [nose[0] / length, nose[1] / length];
    let corner =
        |[ahead, aside]: [f64; 2]| [x + ahead * along - aside * across, y + ahead * across + aside * along];
    let corners = [[9.0, 0.0], [-6.0, 5.5], [-3.0, 0.0], [-6.0, -5.5]].map(corner);
    Mark::Polygon {
        corners: corners.to_vec(),
        fill: Some((colour, 1.0)),
        edge: Some(Pen::solid(Colour([255; 3]), 1.0)),
    }
}
