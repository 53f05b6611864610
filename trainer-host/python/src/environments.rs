//! Many environments of one task, whose columns become rows of numpy.

use std::thread::available_parallelism;
use std::time::Instant;

use kestrel_core::vehicle::State;
use kestrel_sim::gradient::LANES;
use kestrel_sim::outcome::{Episode, Outcome};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::{Purpose, Seed};
use kestrel_sim::simulation::Simulation;
use numpy::ndarray::ArrayViewD;
use numpy::{PyArray1, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray3, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{expected, refused};
use crate::render::picture;
use crate::task::Task;

/// Most environments: a seed has streams for four thousand million, a machine memory for fewer.
const ENVIRONMENTS_LIMIT: usize = 1 << 20;

/// Most environments of one simulation: its columns then stay in the first-level cache while they are transposed.
const SIMULATION_LIMIT: usize = 256;

/// Simulations for each thread, so that none waits long for a slow one.
const SIMULATIONS_PER_THREAD: usize = 4;

/// Environments of one task, stepped by several threads; a row is a drone. The bits do not depend on the number of
/// threads.
#[pyclass(module = "kestrel_drones._native")]
pub(crate) struct Environments {
    scenario: Scenario,
    purpose: Purpose,
    image: Option<[usize; 3]>,
    /// Environments in all.
    count: usize,
    /// Environments of each simulation; the last may have fewer.
    share: usize,
    simulations: Vec<Columns>,
    pool: Option<ThreadPool>,
}

/// A simulation and the actions of its next step, `[action_len][rows]`.
struct Columns {
    simulation: Simulation,
    actions: Vec<f32>,
}

/// What a step gives, as a dictionary.
#[derive(IntoPyObject)]
pub(crate) struct Step<'py> {
    /// After resets, `[rows][observation_len]`.
    observations: Bound<'py, PyArray2<f32>>,
    /// After resets, `[rows][image rows][columns][channels]`.
    images: Option<Bound<'py, PyArray4<u8>>>,
    /// `[rows]`.
    rewards: Bound<'py, PyArray1<f32>>,
    /// `[rows]`.
    terminations: Bound<'py, PyArray1<bool>>,
    /// `[rows]`.
    truncations: Bound<'py, PyArray1<bool>>,
    /// Of the rows whose episodes ended; none where none did.
    ended: Option<Ended<'py>>,
}

/// Where the drones are and how they move, as a dictionary.
#[derive(IntoPyObject)]
pub(crate) struct States<'py> {
    /// Centre of mass, world, `[rows][3]`.
    position_m: Bound<'py, PyArray2<f32>>,
    /// World from body, unit quaternion `w, x, y, z`, `[rows][4]`.
    attitude_wxyz: Bound<'py, PyArray2<f32>>,
    /// The same as a matrix whose columns are the body's axes in the world, `[rows][3][3]`.
    rotation: Bound<'py, PyArray3<f32>>,
    /// World, `[rows][3]`.
    velocity_m_per_s: Bound<'py, PyArray2<f32>>,
    /// Body, `[rows][3]`.
    body_rates_rad_per_s: Bound<'py, PyArray2<f32>>,
    /// In the order of the airframe, `[rows][4]`.
    rotor_speeds_rad_per_s: Bound<'py, PyArray2<f32>>,
    /// Where the drone should be, world, `[rows][3]`.
    goal_m: Bound<'py, PyArray2<f32>>,
}

/// The episodes that a step ended, in the order of their rows.
#[derive(IntoPyObject)]
struct Ended<'py> {
    /// Which, ascending.
    rows: Bound<'py, PyArray1<i64>>,
    /// Before the reset, `[ended][observation_len]`.
    observations: Bound<'py, PyArray2<f32>>,
    /// Before the reset, `[ended][image rows][columns][channels]`.
    images: Option<Bound<'py, PyArray4<u8>>>,
    /// Whether each was a success.
    successes: Bound<'py, PyArray1<bool>>,
    /// Why each ended.
    endings: Vec<&'static str>,
    /// Undiscounted return of each reward term, `[ended][terms]`.
    terms: Bound<'py, PyArray2<f32>>,
}

#[pymethods]
impl Environments {
    /// Environments at the `starts` of "training" or "evaluation", before their first [`Self::reset`].
    #[new]
    fn new(task: &Task, environments: usize, starts: &str, threads: Option<usize>) -> PyResult<Self> {
        if !(1..=ENVIRONMENTS_LIMIT).contains(&environments) {
            return Err(expected("num_envs", environments, format_args!("1 to {ENVIRONMENTS_LIMIT}")));
        }
        let (scenario, purpose) = match starts {
            "training" => (&task.experiment.scenario, Purpose::Reset),
            "evaluation" => (&task.experiment.evaluation.scenario, Purpose::Evaluation),
            other => return Err(expected("starts", other, "training or evaluation")),
        };
        let threads = match threads {
            Some(0) => return Err(expected("threads", 0, "1 or more, or None for all cores")),
            Some(threads) => threads,
            None => available_parallelism().map_or(1, usize::from),
        };
        let share = environments.div_ceil(SIMULATIONS_PER_THREAD * threads).next_multiple_of(LANES);
        let share = share.min(SIMULATION_LIMIT);
        let pool =
            (threads > 1 && environments > share).then(|| ThreadPoolBuilder::new().num_threads(threads).build());
        Ok(Self {
            scenario: scenario.clone(),
            purpose,
            image: task.image_shape(),
            count: environments,
            share,
            simulations: Vec::new(),
            pool: pool.transpose().map_err(refused)?,
        })
    }

    /// Begins new episodes in all environments, whose randomness follows from `seed` and their index.
    fn reset(&mut self, py: Python<'_>, seed: u64) {
        py.detach(|| {
            let Self { scenario, purpose, count, share, pool, .. } = self;
            let begin = |first: usize| {
                let environments = (*share).min(*count - first);
                let simulation =
                    Simulation::with_purpose(scenario, Seed(seed), *purpose, first as u32, environments);
                Columns { actions: vec![0.0; scenario.action.len() * simulation.rows()], simulation }
            };
            let firsts: Vec<usize> = (0..*count).step_by(*share).collect();
            self.simulations = match pool {
                Some(pool) => pool.install(|| firsts.into_par_iter().map(begin).collect()),
                None => firsts.into_iter().map(begin).collect(),
            };
        });
    }

    /// One step with `actions [rows][action_len]`; ended episodes begin anew.
    fn step<'py>(&mut self, py: Python<'py>, actions: PyReadonlyArrayDyn<'py, f32>) -> PyResult<Step<'py>> {
        self.load(actions.as_array())?;
        let observations = py.detach(|| {
            self.advance(|columns, observations| {
                columns.simulation.step(&columns.actions);
                transpose(columns.simulation.observations(), columns.simulation.rows(), observations);
            })
        });
        let (mut rewards, mut terminations, mut truncations) = (Vec::new(), Vec::new(), Vec::new());
        for simulation in self.simulations() {
            rewards.extend_from_slice(simulation.rewards());
            terminations.extend(simulation.outcomes().iter().map(|outcome| *outcome == Outcome::Terminated));
            truncations.extend(simulation.outcomes().iter().map(|outcome| *outcome == Outcome::Truncated));
        }
        Ok(Step {
            rewards: PyArray1::from_vec(py, rewards),
            terminations: PyArray1::from_vec(py, terminations),
            truncations: PyArray1::from_vec(py, truncations),
            images: self.images(py)?,
            ended: self.ended(py)?,
            observations: self.rows_of(py, observations)?,
        })
    }

    /// Steps per second of all environments with `actions [steps][rows][action_len]` in turn, for about `secs`, without
    /// Python: what the simulator does alone, for benchmarks.
    fn rate(&mut self, py: Python<'_>, actions: PyReadonlyArray3<'_, f32>, secs: f64) -> PyResult<f64> {
        let mut script = Vec::new();
        for step in actions.as_array().outer_iter() {
            self.load(step.into_dyn())?;
            script.push(self.simulations.iter().map(|columns| columns.actions.clone()).collect::<Vec<_>>());
        }
        let (begun, script) = (Instant::now(), &script);
        let fly = |index: usize, simulation: &mut Simulation| {
            for actions in script {
                simulation.step(&actions[index]);
            }
            simulation.take_episodes();
        };
        let mut steps = 0;
        py.detach(|| {
            while begun.elapsed().as_secs_f64() < secs {
                let simulations = &mut self.simulations;
                match &self.pool {
                    Some(pool) => pool.install(|| {
                        let numbered = simulations.par_iter_mut().enumerate();
                        numbered.for_each(|(index, columns)| fly(index, &mut columns.simulation));
                    }),
                    None => simulations
                        .iter_mut()
                        .enumerate()
                        .for_each(|(index, columns)| fly(index, &mut columns.simulation)),
                }
                steps += script.len() * self.count;
            }
        });
        Ok(steps as f64 / begun.elapsed().as_secs_f64())
    }

    /// What the drones observe now, `[rows][observation_len]`.
    fn observations<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let observations = self.advance(|columns, observations| {
            transpose(columns.simulation.observations(), columns.simulation.rows(), observations);
        });
        self.rows_of(py, observations)
    }

    /// What their cameras see now, `[rows][image rows][columns][channels]`; none without.
    fn images<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray4<u8>>>> {
        let images = self.simulations().flat_map(Simulation::images).copied().collect();
        self.shaped(py, images)
    }

    /// Where the drones are now: "true", or as "known" to the policy, late where the task has a latency.
    fn states<'py>(&self, py: Python<'py>, which: &str) -> PyResult<States<'py>> {
        let state_of = match which {
            "true" => Simulation::state,
            "known" => Simulation::known_state,
            other => return Err(expected("states", other, "true or known")),
        };
        if self.simulations.is_empty() {
            return Err(expected("states", "no reset before it", "reset() first"));
        }
        let rows: Vec<(&Simulation, usize)> = self
            .simulations()
            .flat_map(|simulation| (0..simulation.rows()).map(move |row| (simulation, row)))
            .collect();
        let states: Vec<State<f32>> = rows.iter().map(|(simulation, row)| state_of(simulation, *row)).collect();
        let column = |values: &mut dyn Iterator<Item = f32>| self.rows_of(py, values.collect());
        let quaternion = |state: &State<f32>| {
            let attitude = state.world_from_body;
            [attitude.w, attitude.x, attitude.y, attitude.z]
        };
        let matrices = states.iter().flat_map(|state| state.world_from_body.rows()).flatten().collect();
        Ok(States {
            position_m: column(&mut states.iter().flat_map(|state| <[f32; 3]>::from(state.position)))?,
            attitude_wxyz: column(&mut states.iter().flat_map(quaternion))?,
            rotation: PyArray1::from_vec(py, matrices).reshape([states.len(), 3, 3])?,
            velocity_m_per_s: column(&mut states.iter().flat_map(|state| <[f32; 3]>::from(state.velocity)))?,
            body_rates_rad_per_s: column(&mut states.iter().flat_map(|state| <[f32; 3]>::from(state.body_rates)))?,
            rotor_speeds_rad_per_s: column(&mut states.iter().flat_map(|state| state.rotor_speeds))?,
            goal_m: column(
                &mut rows.iter().flat_map(|(simulation, row)| <[f32; 3]>::from(simulation.goal(*row))),
            )?,
        })
    }

    /// What only critics read now, `[rows][values]`; no values where the task's critic reads the observation.
    fn privileged<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let mut values = Vec::new();
        for simulation in self.simulations() {
            let (rows, columns) = (simulation.rows(), simulation.privileged());
            let begin = values.len();
            values.resize(begin + columns.len(), 0.0);
            transpose(columns, rows, &mut values[begin..]);
        }
        self.rows_of(py, values)
    }

    /// A picture `[rows][columns][3]` of an environment, in red, green and blue, as a camera behind its drones sees it.
    fn render<'py>(
        &self,
        py: Python<'py>,
        environment: usize,
        size: [usize; 2],
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        if environment >= self.count || self.simulations.is_empty() {
            return Err(expected(
                "render",
                format_args!("environment {environment}"),
                "one of those that reset() began",
            ));
        }
        let simulation = &self.simulations[environment / self.share].simulation;
        let pixels = py.detach(|| picture(simulation, environment % self.share, size));
        PyArray1::from_vec(py, pixels).reshape([size[0], size[1], 3])
    }

    /// Each weighted term of the last step's rewards, `[rows][terms]`.
    fn reward_terms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let rows =
            self.simulations().flat_map(|simulation| (0..simulation.rows()).map(move |row| (simulation, row)));
        let terms = rows.flat_map(|(simulation, row)| simulation.terms(row)).collect();
        self.rows_of(py, terms)
    }
}

impl Environments {
    fn simulations(&self) -> impl Iterator<Item = &Simulation> {
        self.simulations.iter().map(|columns| &columns.simulation)
    }

    fn rows(&self) -> usize {
        self.count * self.scenario.agents.count as usize
    }

    /// Does something with every simulation and its part of `[rows][observation_len]`.
    fn advance(&mut self, act: impl Fn(&mut Columns, &mut [f32]) + Sync) -> Vec<f32> {
        let rows = self.share * self.scenario.agents.count as usize;
        let part = rows * self.scenario.observation.len();
        let mut observations = vec![0.0; self.rows() * self.scenario.observation.len()];
        let simulations = &mut self.simulations;
        if let Some(pool) = &self.pool {
            pool.install(|| {
                let parts = observations.par_chunks_mut(part);
                simulations.par_iter_mut().zip(parts).for_each(|(columns, part)| act(columns, part));
            });
        } else {
            let parts = observations.chunks_mut(part);
            simulations.iter_mut().zip(parts).for_each(|(columns, part)| act(columns, part));
        }
        observations
    }

    /// Takes the actions over, so that nobody writes to them while threads read them.
    fn load(&mut self, actions: ArrayViewD<'_, f32>) -> PyResult<()> {
        if self.simulations.is_empty() {
            return Err(expected("step", "no reset before it", "reset() first"));
        }
        let wanted = [self.rows(), self.scenario.action.len()];
        if actions.shape() != wanted {
            return Err(expected("actions", format_args!("{:?}", actions.shape()), format_args!("{wanted:?}")));
        }
        let actions = actions.as_standard_layout();
        let mut rows = actions.as_slice().expect("it is in standard layout");
        let len = wanted[1];
        for columns in &mut self.simulations {
            let count = columns.simulation.rows();
            let (own, others) = rows.split_at(count * len);
            for (value, column) in columns.actions.chunks_exact_mut(count).enumerate() {
                for (number, row) in column.iter_mut().zip(own.chunks_exact(len)) {
                    *number = row[value];
                }
            }
            rows = others;
        }
        Ok(())
    }

    fn rows_of<'py>(&self, py: Python<'py>, values: Vec<f32>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let width = values.len() / self.rows();
        PyArray1::from_vec(py, values).reshape([self.rows(), width])
    }

    fn shaped<'py>(&self, py: Python<'py>, images: Vec<u8>) -> PyResult<Option<Bound<'py, PyArray4<u8>>>> {
        let Some([rows, columns, channels]) = self.image else { return Ok(None) };
        let count = images.len() / (rows * columns * channels);
        PyArray1::from_vec(py, images).reshape([count, rows, columns, channels]).map(Some)
    }

    fn ended<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Ended<'py>>> {
        let (mut first_row, mut first_environment) = (0, 0);
        let (mut rows, mut episodes): (Vec<i64>, Vec<Episode>) = (Vec::new(), Vec::new());
        let (mut observations, mut images) = (Vec::new(), Vec::new());
        for Columns { simulation, .. } in &mut self.simulations {
            let (count, environments) = (simulation.rows(), simulation.environments());
            let row_of = |episode: &Episode| {
                episode.agent as usize * environments + episode.environment as usize - first_environment
            };
            let mut ended = simulation.take_episodes();
            ended.sort_by_key(row_of);
            for row in ended.iter().map(row_of) {
                rows.push((first_row + row) as i64);
                observations.extend(simulation.final_observations().chunks_exact(count).map(|column| column[row]));
                let len = simulation.final_images().len() / count;
                images.extend_from_slice(&simulation.final_images()[row * len..][..len]);
            }
            episodes.extend(ended);
            first_row += count;
            first_environment += environments;
        }
        if rows.is_empty() {
            return Ok(None);
        }
        let terms: Vec<f32> = episodes.iter().flat_map(|episode| episode.terms.iter().copied()).collect();
        let (ended, widths) = (rows.len(), [observations.len(), terms.len()].map(|len| len / rows.len()));
        Ok(Some(Ended {
            rows: PyArray1::from_vec(py, rows),
            observations: PyArray1::from_vec(py, observations).reshape([ended, widths[0]])?,
            images: self.shaped(py, images)?,
            successes: PyArray1::from_vec(py, episodes.iter().map(|episode| episode.success).collect()),
            endings: episodes.iter().map(|episode| episode.ending.name()).collect(),
            terms: PyArray1::from_vec(py, terms).reshape([ended, widths[1]])?,
        }))
    }
}

/// Rows that are transposed together: a cache line of each column.
const TILE: usize = 16;

/// Columns `[values][rows]` as `[rows][values]`.
fn transpose(columns: &[f32], rows: usize, target: &mut [f32]) {
    let len = columns.len() / rows;
    if len == 0 {
        return;
    }
    for (tile, target) in target.chunks_mut(TILE * len).enumerate() {
        let first = tile * TILE;
        let count = target.len() / len;
        for (value, column) in columns.chunks_exact(rows).enumerate() {
            for (row, number) in target.chunks_exact_mut(len).zip(&column[first..first + count]) {
                row[value] = *number;
            }
        }
    }
}
