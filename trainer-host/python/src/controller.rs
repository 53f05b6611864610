//! What is on either side of a network that something else computes.

use kestrel_core::action::ACTION_LIMIT;
use kestrel_core::attitude::Attitude;
use kestrel_core::nalgebra::Vector3;
use kestrel_core::pilot::PolicyController;
use kestrel_core::policy_file::PolicyMetadata;
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::expected;
use crate::policy::Policy;
use crate::task::Task;

/// The observations and rotor speeds of some drones, a row each, as firmware computes them around its policy.
#[pyclass(module = "kestrel_drones._native")]
pub(crate) struct Controller {
    metadata: PolicyMetadata<'static>,
    rows: Vec<Row>,
}

/// One drone: its controller, and where it was when it was last observed.
struct Row {
    controller: PolicyController,
    state: State<f32>,
    setpoint: Setpoint<f32>,
}

/// What a controller is told of each drone, a row each, as a dictionary.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Told<'py> {
    /// Centre of mass, world, `[rows][3]`.
    position_m: Column<'py>,
    /// World from body, unit quaternion `w, x, y, z`, `[rows][4]`.
    attitude_wxyz: Column<'py>,
    /// World, `[rows][3]`.
    velocity_m_per_s: Column<'py>,
    /// Body, `[rows][3]`.
    body_rates_rad_per_s: Column<'py>,
    /// Where the drone should be, world, `[rows][3]`.
    goal_m: Column<'py>,
    /// Where its nose should point, `[rows][1]`.
    yaw_rad: Column<'py>,
    /// What sensors measured, in the order and the scales of the task, `[rows][values]`.
    measurements: Column<'py>,
}

type Column<'py> = PyReadonlyArray2<'py, f32>;

/// Whose layouts a controller has.
#[derive(FromPyObject)]
pub(crate) enum Pilot {
    Policy(Py<Policy>),
    Task(Py<Task>),
}

#[pymethods]
impl Controller {
    /// So many drones, at the start of their flights.
    #[new]
    fn new(pilot: Pilot, drones: usize) -> PyResult<Self> {
        let metadata = match pilot {
            Pilot::Policy(policy) => {
                let policy = policy.get().parsed()?;
                PolicyMetadata { name: "", ..*policy.metadata() }
            }
            Pilot::Task(task) => {
                let scenario = &task.get().experiment.scenario;
                PolicyMetadata {
                    name: "",
                    observation: scenario.observation,
                    action: scenario.action,
                    control_period_secs: scenario.physics.control_secs(),
                    seed: 0,
                    training_steps: 0,
                    airframe: None,
                }
            }
        };
        let rows = (0..drones).map(|_| Row::new(&metadata)).collect();
        Ok(Self { metadata, rows })
    }

    /// Values of an observation.
    #[getter]
    fn observation_len(&self) -> usize {
        self.metadata.observation.len()
    }

    /// Values of an action.
    #[getter]
    fn action_len(&self) -> usize {
        self.metadata.action.len()
    }

    /// Time from one action to the next \[s\].
    #[getter]
    fn control_secs(&self) -> f32 {
        self.metadata.control_period_secs
    }

    /// Begins new flights of those drones for which `rows` is true.
    fn clear(&mut self, rows: Vec<bool>) -> PyResult<()> {
        if rows.len() != self.rows.len() {
            return Err(expected("rows", rows.len(), format_args!("{}: one for each drone", self.rows.len())));
        }
        for (row, _) in self.rows.iter_mut().zip(rows).filter(|(_, cleared)| *cleared) {
            row.controller.reset(&self.metadata);
        }
        Ok(())
    }

    /// Observations `[rows][observation_len]` of drones that are `told` where they are.
    fn observe<'py>(&mut self, py: Python<'py>, told: Told<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let positions = self.vectors("position_m", &told.position_m)?;
        let attitudes = self.values::<4>("attitude_wxyz", &told.attitude_wxyz)?;
        let velocities = self.vectors("velocity_m_per_s", &told.velocity_m_per_s)?;
        let body_rates = self.vectors("body_rates_rad_per_s", &told.body_rates_rad_per_s)?;
        let goals = self.vectors("goal_m", &told.goal_m)?;
        let headings = self.values::<1>("yaw_rad", &told.yaw_rad)?;
        let measurements = told.measurements.as_array();
        if measurements.nrows() != self.rows.len() {
            let wanted = format_args!("{}: one for each drone", self.rows.len());
            return Err(expected("rows of measurements", measurements.nrows(), wanted));
        }
        let mut observations = Vec::with_capacity(self.rows.len() * self.metadata.observation.len());
        for (index, row) in self.rows.iter_mut().enumerate() {
            let [w, x, y, z] = attitudes[index];
            row.state = State {
                position: positions[index],
                world_from_body: Attitude { w, x, y, z },
                velocity: velocities[index],
                body_rates: body_rates[index],
                rotor_speeds: [0.0; 4],
            };
            row.setpoint = Setpoint { yaw: headings[index][0], ..Setpoint::at(goals[index]) };
            let measured: Vec<f32> = measurements.row(index).to_vec();
            let Row { controller, state, setpoint } = row;
            observations.extend_from_slice(controller.observe(&self.metadata, &measured, state, setpoint));
        }
        PyArray1::from_vec(py, observations).reshape([self.rows.len(), self.metadata.observation.len()])
    }

    /// Rotor targets `[rows][4]` \[rad/s\] of `actions [rows][action_len]` where the drones were last observed.
    fn rotor_speeds<'py>(
        &mut self,
        py: Python<'py>,
        actions: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let wanted = [self.rows.len(), self.metadata.action.len()];
        let actions = actions.as_array();
        if actions.shape() != wanted {
            return Err(expected("actions", format_args!("{:?}", actions.shape()), format_args!("{wanted:?}")));
        }
        let mut targets = Vec::with_capacity(4 * self.rows.len());
        for (row, values) in self.rows.iter_mut().zip(actions.outer_iter()) {
            let mut action = [0.0; ACTION_LIMIT];
            for (number, value) in action.iter_mut().zip(&values) {
                *number = value.clamp(-1.0, 1.0);
            }
            let Row { controller, state, setpoint } = row;
            targets.extend(controller.rotor_targets(&self.metadata, action, state, setpoint));
        }
        PyArray1::from_vec(py, targets).reshape([self.rows.len(), 4])
    }

    /// Rotor targets `[rows][4]` \[rad/s\] of the last actions at other `body_rates [rows][3]` \[rad/s\]; none where the action
    /// space has no rate loop.
    fn follow_rates<'py>(
        &self,
        py: Python<'py>,
        body_rates: Column<'py>,
    ) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let body_rates = self.vectors("body_rates_rad_per_s", &body_rates)?;
        let targets: Option<Vec<[f32; 4]>> = self
            .rows
            .iter()
            .zip(body_rates)
            .map(|(row, rates)| row.controller.follow_rates(&self.metadata, &rates))
            .collect();
        let Some(targets) = targets else { return Ok(None) };
        PyArray1::from_vec(py, targets.concat()).reshape([self.rows.len(), 4]).map(Some)
    }
}

impl Controller {
    /// The rows of a column with so many values each.
    fn values<const N: usize>(&self, name: &str, column: &Column<'_>) -> PyResult<Vec<[f32; N]>> {
        let (column, wanted) = (column.as_array(), [self.rows.len(), N]);
        if column.shape() != wanted {
            return Err(expected(name, format_args!("{:?}", column.shape()), format_args!("{wanted:?}")));
        }
        Ok(column.outer_iter().map(|row| std::array::from_fn(|index| row[index])).collect())
    }

    fn vectors(&self, name: &str, column: &Column<'_>) -> PyResult<Vec<Vector3<f32>>> {
        Ok(self.values::<3>(name, column)?.into_iter().map(Vector3::from).collect())
    }
}

impl Row {
    fn new(metadata: &PolicyMetadata<'_>) -> Self {
        let origin = Vector3::zeros();
        let state = State {
            position: origin,
            world_from_body: Attitude::level(),
            velocity: origin,
            body_rates: origin,
            rotor_speeds: [0.0; 4],
        };
        Self { controller: PolicyController::new(metadata), state, setpoint: Setpoint::at(origin) }
    }
}
