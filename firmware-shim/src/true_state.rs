//! The true-state log: what really happened, for judges who do not take a vehicle's word for it.

use std::fs::File;
use std::io::{self, LineWriter, Write};
use std::path::{Path, PathBuf};

use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use serde::Serialize;

use crate::bridge::event::BridgeStep;
use crate::lockstep::ControlPeriod;

/// The log cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write the true-state log {}: {reason}", path.display())]
pub struct TrueStateLogError {
    /// Of the log.
    pub path: PathBuf,
    /// Reason of the operating system.
    pub reason: io::Error,
}

/// One line of the log of a vehicle.
#[derive(Serialize)]
struct LogLine {
    /// Simulated time \[s\].
    secs: f64,
    /// \[m\], world.
    position: [f32; 3],
    /// \[m/s\], world.
    velocity: [f32; 3],
    /// Unit quaternion w, x, y, z: from body to world.
    attitude: [f32; 4],
    armed: bool,
    mode: &'static str,
    /// \[rad/s\].
    rotor_targets: [f32; 4],
}

/// One line of the log of a bridge, which does not know what its autopilot is doing.
#[derive(Serialize)]
struct StepLine {
    /// Simulated time \[s\].
    secs: f64,
    /// \[m\], world.
    position: [f32; 3],
    /// \[m/s\], world.
    velocity: [f32; 3],
    /// Unit quaternion w, x, y, z: from body to world.
    attitude: [f32; 4],
    /// \[rad/s\].
    rotor_targets: [f32; 4],
}

/// A log, if one is wanted: one JSON object a control period; whole lines appear in the file as they are written.
#[derive(Debug)]
pub struct TrueStateLog {
    file: Option<(PathBuf, LineWriter<File>)>,
}

impl TrueStateLog {
    /// Creates the file, or empties it.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(path: Option<&Path>) -> Result<Self, TrueStateLogError> {
        let Some(path) = path else { return Ok(Self { file: None }) };
        let path = path.to_owned();
        match File::create(&path) {
            Ok(file) => Ok(Self { file: Some((path, LineWriter::new(file))) }),
            Err(reason) => Err(TrueStateLogError { path, reason }),
        }
    }

    /// Adds a line.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&mut self, period: &ControlPeriod) -> Result<(), TrueStateLogError> {
        self.write_line(&LogLine {
            secs: period.secs,
            position: period.state.position.into(),
            velocity: period.state.velocity.into(),
            attitude: quaternion(period.state),
            armed: period.mode.armed(),
            mode: period.mode.name(),
            rotor_targets: period.rotor_targets,
        })
    }

    /// Adds a line of a simulation that another autopilot flies.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_step(&mut self, step: &BridgeStep<'_>) -> Result<(), TrueStateLogError> {
        self.write_line(&StepLine {
            secs: step.secs,
            position: step.state.position.into(),
            velocity: step.state.velocity.into(),
            attitude: quaternion(step.state),
            rotor_targets: step.rotor_targets,
        })
    }

    fn write_line(&mut self, line: &impl Serialize) -> Result<(), TrueStateLogError> {
        let Some((path, file)) = &mut self.file else { return Ok(()) };
        let written = serde_json::to_writer(&mut *file, line).map_err(io::Error::from);
        let whole = written.and_then(|()| file.write_all(b"\n"));
        whole.map_err(|reason| TrueStateLogError { path: path.clone(), reason })
    }
}

fn quaternion(state: &State<f32>) -> [f32; 4] {
    let Attitude { w, x, y, z } = state.world_from_body;
    [w, x, y, z]
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::CF2X;

    use super::*;
    use crate::autopilot::Mode;
    use crate::controller::Controller;
    use crate::plant::{FlatFloor, Plant};

    fn write(path: Option<&Path>) -> Result<(), TrueStateLogError> {
        let plant = FlatFloor::new(&CF2X, 0.01);
        let period = ControlPeriod {
            number: 0,
            secs: 0.5,
            state: plant.state(),
            mode: Mode::TakingOff,
            controller: Controller::Policy,
            rotor_targets: [1.0; 4],
        };
        let mut log = TrueStateLog::create(path)?;
        log.write(&period).and_then(|()| log.write(&period))
    }

    #[test]
    fn a_line_holds_a_moment() {
        let path = std::env::temp_dir().join(format!("kestrel-true-state-{}.jsonl", std::process::id()));
        write(Some(&path)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let line = "{\"secs\":0.5,\"position\":[0.0,0.0,0.0125],\"velocity\":[0.0,0.0,0.0],\
                    \"attitude\":[1.0,0.0,0.0,0.0],\"armed\":true,\"mode\":\"taking off\",\"rotor_targets\":[1.0,1.0,1.0,1.0]}\n";
        assert_eq!(text, line.repeat(2));
    }

    #[test]
    fn a_line_holds_a_step() {
        let path = std::env::temp_dir().join(format!("kestrel-true-steps-{}.jsonl", std::process::id()));
        let plant = FlatFloor::new(&CF2X, 0.01);
        let step = BridgeStep { secs: 0.5, state: plant.state(), rotor_targets: [1.0; 4] };
        TrueStateLog::create(Some(&path)).unwrap().write_step(&step).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let line = "{\"secs\":0.5,\"position\":[0.0,0.0,0.0125],\"velocity\":[0.0,0.0,0.0],\
                    \"attitude\":[1.0,0.0,0.0,0.0],\"rotor_targets\":[1.0,1.0,1.0,1.0]}\n";
        assert_eq!(text, line);
    }

    #[test]
    fn no_log_is_no_error_and_one_that_cannot_be_written_is_named() {
        write(None).unwrap();
        let error = write(Some(Path::new("no/such/folder/true.jsonl"))).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("cannot write the true-state log no/such/folder/true.jsonl: "), "{text}");
    }
}
