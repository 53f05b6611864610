//! An environment for tests: points in a plane that drift and are to be kept near its origin, with everything that a task
//! may have: teams, privileged values, images, a teacher, episodes that terminate and episodes that are truncated.

use std::ops::Range;

use kestrel_core::encoder::Volume;
use kestrel_core::seed::{Purpose, Seed, Stream};
use serde::{Deserialize, Serialize};

use crate::environment::{Environment, Episode, Outcome, TaskShape};

pub(super) const OBSERVATION_LEN: usize = 6;
pub(super) const PRIVILEGED_LEN: usize = 2;
pub(super) const ACTION_LEN: usize = 2;

/// How far a point may go.
const BOUND: f32 = 1.5;

/// What is to be learned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Task {
    pub(super) agents: usize,
    pub(super) is_privileged: bool,
    pub(super) image: Option<Volume>,
    pub(super) has_teacher: bool,
    pub(super) episode_steps: u32,
}

/// One point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Point {
    position: [f32; 2],
    velocity: [f32; 2],
    last_action: [f32; 2],
    drift: [f32; 2],
    steps: u32,
    total_reward: f32,
    stream: Stream,
}

/// Points side by side.
#[derive(Clone, Debug)]
pub(crate) struct Probe {
    task: Task,
    points: Vec<Point>,
    now: Columns,
    before_reset: Columns,
    rewards: Vec<f32>,
    outcomes: Vec<Outcome>,
    episodes: Vec<Episode>,
}

/// What is observed of all points.
#[derive(Clone, Debug)]
struct Columns {
    observations: Vec<f32>,
    privileged: Vec<f32>,
    images: Vec<u8>,
}

impl Point {
    fn begin(mut stream: Stream) -> Self {
        let [position, velocity, drift] =
            [0.5, 0.3, 1.0].map(|limit| [(); 2].map(|()| stream.between(-limit, limit)));
        Self { position, velocity, last_action: [0.0; 2], drift, steps: 0, total_reward: 0.0, stream }
    }

    fn advance(&mut self, action: [f32; 2], episode_steps: u32) -> (f32, Outcome) {
        self.last_action = action.map(|value| value.clamp(-1.0, 1.0));
        for axis in 0..2 {
            self.velocity[axis] =
                0.9 * self.velocity[axis] + 0.1 * self.last_action[axis] + 0.02 * self.drift[axis];
            self.position[axis] += 0.5 * self.velocity[axis];
        }
        self.steps += 1;
        let reward = 0.1 - self.distance();
        self.total_reward += reward;
        let outcome = match self.steps {
            _ if self.distance() > BOUND => Outcome::Terminated,
            steps if steps == episode_steps => Outcome::Truncated,
            _ => Outcome::Running,
        };
        (reward, outcome)
    }

    fn distance(&self) -> f32 {
        self.position[0].hypot(self.position[1])
    }

    /// A bright spot where the point is.
    fn draw(&self, image: Volume) -> impl Iterator<Item = u8> {
        let [rows, columns, channels] = [image.rows, image.columns, image.channels].map(usize::from);
        let [x, y] = self.position;
        (0..rows * columns * channels).map(move |index| {
            let (pixel, channel) = (index / channels, index % channels);
            let at = |place: usize, count: usize| 2.0 * BOUND * (place as f32 / count as f32 - 0.5);
            let away = [at(pixel % columns, columns) - x, at(pixel / columns, rows) - y];
            (220.0 * libm::expf(-(1.0 + channel as f32) * (away[0] * away[0] + away[1] * away[1]))) as u8
        })
    }
}

impl Columns {
    fn new(task: &Task, rows: usize) -> Self {
        let shape = Probe::shape(task);
        Self {
            observations: vec![0.0; shape.observation_len * rows],
            privileged: vec![0.0; shape.privileged_len * rows],
            images: vec![0; shape.image_len() * rows],
        }
    }

    fn write(&mut self, task: &Task, (row, rows): (usize, usize), point: &Point) {
        let observed = [point.position, point.velocity, point.last_action].into_iter().flatten();
        for (column, value) in self.observations.chunks_exact_mut(rows).zip(observed) {
            column[row] = value;
        }
        for (column, value) in self.privileged.chunks_exact_mut(rows).zip(point.drift) {
            column[row] = value;
        }
        if let Some(image) = task.image {
            let bytes = &mut self.images[row * image.len()..][..image.len()];
            bytes.iter_mut().zip(point.draw(image)).for_each(|(byte, value)| *byte = value);
        }
    }
}

impl Probe {
    pub(super) fn points(&self) -> &[Point] {
        &self.points
    }

    pub(super) fn teacher_action(point: &Point) -> [f32; 2] {
        let Point { position, velocity, .. } = point;
        [0, 1].map(|axis| (-2.0 * position[axis] - 3.0 * velocity[axis]).clamp(-1.0, 1.0))
    }

    fn observe(&mut self) {
        let rows = self.points.len();
        for (row, point) in self.points.iter().enumerate() {
            self.now.write(&self.task, (row, rows), point);
        }
    }
}

impl Environment for Probe {
    type Task = Task;
    type State = Vec<Point>;

    fn name(_task: &Task) -> &'static str {
        "probe"
    }

    fn shape(task: &Task) -> TaskShape {
        TaskShape {
            agents: task.agents,
            observation_len: OBSERVATION_LEN,
            privileged_len: if task.is_privileged { PRIVILEGED_LEN } else { 0 },
            action_len: ACTION_LEN,
            image: task.image,
        }
    }

    fn has_teacher(task: &Task) -> bool {
        task.has_teacher
    }

    fn begin(task: &Task, seed: Seed, first: u32, count: usize) -> Self {
        let rows = task.agents * count;
        let stream = |row: usize| {
            let (agent, environment) = (row / count, first + (row % count) as u32);
            Stream::of_agent(seed, environment, agent as u32, Purpose::Reset)
        };
        let mut probe = Self {
            task: *task,
            points: (0..rows).map(|row| Point::begin(stream(row))).collect(),
            now: Columns::new(task, rows),
            before_reset: Columns::new(task, rows),
            rewards: vec![0.0; rows],
            outcomes: vec![Outcome::Running; rows],
            episodes: Vec::new(),
        };
        probe.observe();
        probe
    }

    fn step(&mut self, actions: &[f32]) {
        let rows = self.points.len();
        for (row, point) in self.points.iter_mut().enumerate() {
            let action = [actions[row], actions[rows + row]];
            (self.rewards[row], self.outcomes[row]) = point.advance(action, self.task.episode_steps);
            if self.outcomes[row] != Outcome::Running {
                self.before_reset.write(&self.task, (row, rows), point);
                let Point { steps, total_reward, .. } = *point;
                let success = Some(self.outcomes[row] == Outcome::Truncated);
                self.episodes.push(Episode { steps, total_reward, success, terms: vec![total_reward] });
                *point = Point::begin(point.stream.clone());
            }
        }
        self.observe();
    }

    fn observations(&self) -> &[f32] {
        &self.now.observations
    }

    fn privileged(&self) -> &[f32] {
        &self.now.privileged
    }

    fn images(&self) -> &[u8] {
        &self.now.images
    }

    fn rewards(&self) -> &[f32] {
        &self.rewards
    }

    fn outcomes(&self) -> &[Outcome] {
        &self.outcomes
    }

    fn final_observations(&self) -> &[f32] {
        &self.before_reset.observations
    }

    fn final_privileged(&self) -> &[f32] {
        &self.before_reset.privileged
    }

    fn final_images(&self) -> &[u8] {
        &self.before_reset.images
    }

    fn write_teacher_actions(&mut self, rows: Range<usize>, actions: &mut [f32]) {
        let count = rows.len();
        for (index, point) in self.points[rows].iter().enumerate() {
            for (column, value) in actions.chunks_exact_mut(count).zip(Self::teacher_action(point)) {
                column[index] = value;
            }
        }
    }

    fn take_episodes(&mut self) -> Vec<Episode> {
        std::mem::take(&mut self.episodes)
    }

    fn save(&self) -> Vec<Point> {
        self.points.clone()
    }

    fn restore(&mut self, state: &Vec<Point>) -> bool {
        let fits = state.len() == self.points.len();
        if fits {
            self.points.clone_from(state);
            self.observe();
        }
        fits
    }
}
