//! Learning curves: what test flights achieve while a task is being trained.

use crate::statistics::sample::Sample;
use crate::study::data::{MethodKind, Run, StudyData};
use crate::study::report::score::{after, episode_return, success};
use crate::study::rows::CurveRow;
use kestrel_draw::chart::{
    Axes, Axis, INK, MARGIN, MUTED, TOP, colour, pen, titled, width_of, with_unit, wrapped,
};
use kestrel_draw::drawing::{Anchor, Drawing, Pen, Text};

/// Places along the budget at which the runs are compared.
const PLACES: usize = 80;

/// Space left of the panels, for the methods' labels \[px\].
const LABELS: f64 = 190.0;

/// Height of a panel, and the space beside and below it \[px\].
const HEIGHT: f64 = 112.0;
const GAP: f64 = 30.0;
const BELOW: f64 = 34.0;

/// What a curve shows.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Quantity {
    Success,
    /// With what doing nothing returns beside it.
    Return,
}

/// A row per method with curves, a column per task. Joint training has one panel for all tasks.
pub(super) fn draw(data: &StudyData, quantity: Quantity) -> Option<Drawing> {
    let has_curves = |method: &usize| data.runs_of(*method).any(|run| !run.curve.is_empty());
    let methods: Vec<usize> = (0..data.manifest.methods.len()).filter(has_curves).collect();
    let tasks = data.manifest.tasks.len();
    let width = (840.0 / tasks as f64).clamp(130.0, 300.0);
    let total = (LABELS + MARGIN + tasks as f64 * (width + GAP) + 62.0).max(860.0);
    let [title, of] = quantity.words();
    let about = format!("{of} in the task that trains: median over runs, the middle half of them shaded.");
    let mut drawing = titled(total, title, &about);
    let grid = Grid { data, quantity, width, rows: methods.len(), y: quantity.axis(data) };
    grid.draw_headings(&mut drawing);
    for (row, &method) in methods.iter().enumerate() {
        grid.draw_row(&mut drawing, row, method);
    }
    drawing.extend_to(Grid::top(methods.len()) + 48.0);
    (!methods.is_empty()).then_some(drawing)
}

impl Quantity {
    /// The title of the picture, and of what it tells.
    fn words(self) -> [&'static str; 2] {
        match self {
            Self::Success => ["Learning curves", "Success of test flights"],
            Self::Return => ["Learning curves in returns", "Return of test flights"],
        }
    }

    fn of(self) -> fn(&CurveRow) -> f64 {
        match self {
            Self::Success => success,
            Self::Return => episode_return,
        }
    }

    fn axis(self, data: &StudyData) -> Axis {
        match self {
            Self::Success => Axis::shares(0.5),
            Self::Return => Axis::numbers(range_of_returns(data), 3.0),
        }
    }
}

/// From the lowest to the highest return of any run, and of doing nothing; the lowest twentieth is left out, for a
/// crash may cost any amount.
fn range_of_returns(data: &StudyData) -> [f64; 2] {
    let points = data.runs.iter().flat_map(|run| &run.curve).map(episode_return);
    let nothing = (0..data.manifest.tasks.len()).filter_map(|task| data.manifest.return_of_nothing(task));
    let mut returns: Vec<f64> = points.chain(nothing).collect();
    returns.sort_by(f64::total_cmp);
    let [Some(low), Some(high)] = [returns.get(returns.len() / 20), returns.last()] else { return [0.0, 1.0] };
    if high > low { [*low, *high] } else { [low - 1.0, high + 1.0] }
}

struct Grid<'a> {
    data: &'a StudyData,
    quantity: Quantity,
    width: f64,
    rows: usize,
    y: Axis,
}

impl Grid<'_> {
    fn left(&self, column: usize) -> f64 {
        MARGIN + LABELS + 44.0 + column as f64 * (self.width + GAP)
    }

    fn top(row: usize) -> f64 {
        TOP + 46.0 + row as f64 * (HEIGHT + BELOW)
    }

    fn draw_headings(&self, drawing: &mut Drawing) {
        for (column, task) in self.data.manifest.tasks.iter().enumerate() {
            // Names may be long: lines end at their hyphens, and the last stands above the panel.
            let lines = wrapped(&task.name.replace('-', "- "), self.width + GAP, 14.0);
            for (above, words) in lines.iter().rev().take(3).enumerate() {
                let at = [self.left(column), Self::top(0) - 14.0 - 17.0 * above as f64];
                let words = words.replace("- ", "-");
                drawing.text(Text { at, words, size: 14.0, colour: INK, anchor: Anchor::Start });
            }
        }
        let at = [self.left(self.data.manifest.tasks.len()) - GAP, Self::top(self.rows) + 10.0];
        let words = "environment steps of the stage".to_owned();
        drawing.text(Text { at, words, size: 14.0, colour: MUTED, anchor: Anchor::End });
        let start = self.left(0) - width_of("100 %", 13.0);
        let at = [start.max(MARGIN), Self::top(self.rows) + 10.0];
        let nothing = (self.quantity == Quantity::Return).then_some("——  doing nothing");
        let experts = self.experts().filter(|_| self.has_sequences()).map(|_| "- - -  experts' median");
        let words = experts.into_iter().chain(nothing).collect::<Vec<_>>().join(",  ");
        drawing.text(Text { at, words, size: 14.0, colour: MUTED, anchor: Anchor::Start });
    }

    fn draw_row(&self, drawing: &mut Drawing, row: usize, method: usize) {
        let label = &self.data.manifest.methods[method].label;
        for (line, words) in wrapped(label, LABELS - 10.0, 15.0).into_iter().take(4).enumerate() {
            let at = [MARGIN, Self::top(row) + 18.0 + 19.0 * line as f64];
            drawing.text(Text { at, words, size: 15.0, colour: INK, anchor: Anchor::Start });
        }
        if self.data.manifest.methods[method].kind.learns_at_once() {
            return self.draw_joint(drawing, row, method);
        }
        for task in 0..self.data.manifest.tasks.len() {
            let panel = self.panel([task, row]);
            panel.draw_axes(drawing);
            self.draw_nothing(drawing, &panel, self.data.manifest.return_of_nothing(task));
            if let Some(experts) = self.experts().filter(|experts| *experts != method) {
                let reference = self.curves_in(experts, task);
                panel.path(drawing, self.quantile(&reference, &panel, 0.5), Pen::dashes(MUTED, 1.5));
            }
            self.draw_curves(drawing, &panel, method, &self.curves_in(method, task));
        }
    }

    /// One panel, whose steps may go on for longer than those of a task.
    fn draw_joint(&self, drawing: &mut Drawing, row: usize, method: usize) {
        let curves = self.curves(method, |_| Some(1));
        let mut panel = self.panel([0, row]);
        let last_steps = curves.iter().filter_map(|curve| curve.last()).map(|last| last.steps as f64);
        let longest = last_steps.fold(0.0, f64::max);
        if longest > 1.001 * panel.x.high {
            panel.x = Axis::steps(longest, 3.0);
        }
        panel.draw_axes(drawing);
        let tasks = 0..self.data.manifest.tasks.len();
        let nothing: Option<Vec<f64>> = tasks.map(|task| self.data.manifest.return_of_nothing(task)).collect();
        let mean = nothing.map(|returns| returns.iter().sum::<f64>() / returns.len() as f64);
        self.draw_nothing(drawing, &panel, mean);
        self.draw_curves(drawing, &panel, method, &curves);
        let words = format!("all tasks at once, {} steps", with_unit(panel.x.high));
        let at = [panel.left + panel.width + 14.0, panel.top + 18.0];
        drawing.text(Text { at, words, size: 14.0, colour: MUTED, anchor: Anchor::Start });
    }

    fn experts(&self) -> Option<usize> {
        self.data.manifest.methods.iter().position(|method| method.kind == MethodKind::Experts)
    }

    /// Whether there is a panel in which the experts are drawn as a reference.
    fn has_sequences(&self) -> bool {
        self.data.manifest.methods.iter().any(|method| method.kind == MethodKind::Sequential)
    }

    fn panel(&self, [column, row]: [usize; 2]) -> Axes {
        let steps = Axis::steps(self.limit(), (self.width / 70.0).max(2.0));
        Axes {
            left: self.left(column),
            top: Self::top(row),
            width: self.width,
            height: HEIGHT,
            x: if row + 1 == self.rows { steps } else { steps.silent() },
            y: if column == 0 { self.y.clone() } else { self.y.clone().silent() },
        }
    }

    fn limit(&self) -> f64 {
        self.data.manifest.steps_per_stage.max(1) as f64
    }

    fn curves_in(&self, method: usize, task: usize) -> Vec<Vec<&CurveRow>> {
        self.curves(method, |run| {
            self.data.order(run).iter().position(|trained| *trained == task).map(|position| position + 1)
        })
    }

    fn curves(&self, method: usize, stage: impl Fn(&Run) -> Option<usize>) -> Vec<Vec<&CurveRow>> {
        let curves = self.data.runs_of(method).filter_map(|run| Some(run.curve_of(stage(run)?).collect()));
        curves.filter(|curve: &Vec<&CurveRow>| !curve.is_empty()).collect()
    }

    /// A line at the return of doing nothing, where returns are shown.
    fn draw_nothing(&self, drawing: &mut Drawing, panel: &Axes, nothing: Option<f64>) {
        if let Some(level) = nothing.filter(|_| self.quantity == Quantity::Return) {
            panel.path(drawing, [[panel.x.low, level], [panel.x.high, level]], Pen::solid(INK, 1.0));
        }
    }

    fn draw_curves(&self, drawing: &mut Drawing, panel: &Axes, method: usize, curves: &[Vec<&CurveRow>]) {
        let quartiles = [0.25, 0.75].map(|share| self.quantile(curves, panel, share));
        let [low, high] = &quartiles;
        let band: Vec<[f64; 3]> =
            low.iter().zip(high).map(|([steps, low], [_, high])| [*steps, *low, *high]).collect();
        panel.band(drawing, &band, colour(method), 0.25);
        panel.path(drawing, self.quantile(curves, panel, 0.5), pen(method, 2.5));
    }

    /// What a share of the runs stays below, from the first step of the panel to its last, within its height.
    fn quantile(&self, curves: &[Vec<&CurveRow>], panel: &Axes, share: f64) -> Vec<[f64; 2]> {
        let quantity = self.quantity.of();
        let places = (0..=PLACES).map(|index| panel.x.high * index as f64 / PLACES as f64);
        let of_run = |steps: f64| curves.iter().map(move |curve| (0, after(curve, steps, quantity)));
        places
            .filter_map(|steps| Some([steps, Sample::new(of_run(steps)).quantile(&[1], share)?]))
            .map(|[steps, value]| [steps, value.clamp(panel.y.low, panel.y.high)])
            .collect()
    }
}
