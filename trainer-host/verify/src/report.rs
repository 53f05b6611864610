//! What was compared and how far apart it was, one line a kind.

use std::collections::BTreeMap;
use std::fmt;

/// What a line of the report compares, in the order of the report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// State after one physics step.
    OneStep,
    /// States under recorded rotor speeds.
    OpenLoop,
    /// Where a drone that fell or hit something comes to rest \[m\].
    ContactRest,
    /// Faces of the boxes on whose wrong side it ends.
    ContactSide,
    /// Speed of its rebound, relative.
    ContactRebound,
    /// Time from the first contact until it rests, relative.
    ContactTimeToRest,
    /// Rotor speeds \[RPM\] that the controller commands in recorded states.
    ClosedLoopRpm,
    /// States under recorded rotor speeds.
    ClosedLoopStates,
    /// States of a flight of which only the start and the targets are recorded.
    ClosedLoopFlight,
    /// Quaternions, angles and matrices.
    UnitAttitude,
    /// Rotor speeds \[RPM\], errors and integrals of single controller calls.
    UnitDslPid,
    /// Constants of the drones, relative.
    UnitConstants,
    /// View and projection of the camera, single precision.
    UnitCamera,
    /// Share of a scene's pixels whose silhouette is off by more than a pixel.
    CameraLabels,
    /// Share of its pixels whose depth is off by more than 1 %, or 4 % on a sphere.
    CameraDepths,
    /// Share of its pixels whose colour is off by more than three levels of 255.
    CameraColours,
    /// Rotor speeds \[RPM\] of actions in recorded states of upstream's learning environments.
    RlRpm,
    /// Their states under recorded rotor speeds.
    RlStates,
    /// Their rewards, endings and observations, flown by the simulator; a wrong ending is infinitely wrong.
    RlTask,
    /// State after one physics step of the thesis's fork.
    ThesisOneStep,
    /// Rotor speeds \[RPM\] of actions in recorded states of the thesis's environments.
    ThesisRpm,
    /// Their states under recorded rotor speeds.
    ThesisStates,
    /// Their rewards component by component, endings and observations, flown by the simulator.
    ThesisTask,
    /// The same, but for observations, in steps in which the drone touches something.
    ThesisContact,
    /// States under recorded rotor speeds in the fork's golden file.
    ForkStates,
    /// Rotor speeds \[RPM\] of actions in its recorded states.
    ForkRpm,
    /// Rotor speeds \[RPM\] of its calls of one `DSLPIDControl`.
    ForkDslPid,
    /// Rotor speeds \[RPM\] of its calls of one `SimplePIDControl`.
    ForkSimplePid,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 28] = [
        Self::OneStep,
        Self::OpenLoop,
        Self::ContactRest,
        Self::ContactSide,
        Self::ContactRebound,
        Self::ContactTimeToRest,
        Self::ClosedLoopRpm,
        Self::ClosedLoopStates,
        Self::ClosedLoopFlight,
        Self::UnitAttitude,
        Self::UnitDslPid,
        Self::UnitConstants,
        Self::UnitCamera,
        Self::CameraLabels,
        Self::CameraDepths,
        Self::CameraColours,
        Self::RlRpm,
        Self::RlStates,
        Self::RlTask,
        Self::ThesisOneStep,
        Self::ThesisRpm,
        Self::ThesisStates,
        Self::ThesisTask,
        Self::ThesisContact,
        Self::ForkStates,
        Self::ForkRpm,
        Self::ForkDslPid,
        Self::ForkSimplePid,
    ];

    /// As in the report and in `--tolerance`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OneStep => "one_step",
            Self::OpenLoop => "open_loop",
            Self::ContactRest => "contact.rest",
            Self::ContactSide => "contact.side",
            Self::ContactRebound => "contact.rebound",
            Self::ContactTimeToRest => "contact.time_to_rest",
            Self::ClosedLoopRpm => "closed_loop.rpm",
            Self::ClosedLoopStates => "closed_loop.states",
            Self::ClosedLoopFlight => "closed_loop.flight",
            Self::UnitAttitude => "unit.attitude",
            Self::UnitDslPid => "unit.dslpid_calls",
            Self::UnitConstants => "unit.constants",
            Self::UnitCamera => "unit.camera_matrices",
            Self::CameraLabels => "camera.labels",
            Self::CameraDepths => "camera.depths",
            Self::CameraColours => "camera.colours",
            Self::RlRpm => "rl.rpm",
            Self::RlStates => "rl.states",
            Self::RlTask => "rl.task",
            Self::ThesisOneStep => "thesis.one_step",
            Self::ThesisRpm => "thesis.rpm",
            Self::ThesisStates => "thesis.states",
            Self::ThesisTask => "thesis.task",
            Self::ThesisContact => "thesis.contact",
            Self::ForkStates => "fork.states",
            Self::ForkRpm => "fork.rpm",
            Self::ForkDslPid => "fork.dslpid_calls",
            Self::ForkSimplePid => "fork.simplepid_calls",
        }
    }

    /// Greatest error that passes: rounding grows to some 1e-11 over these flights, and a controller amplifies it; in
    /// contact the order of a solver's iterations and a tenth of a millimetre of a tilted wall have their part.
    pub const fn default_tolerance(self) -> f64 {
        match self {
            Self::ContactRest | Self::CameraLabels => 1e-3,
            Self::ContactSide => 0.0,
            Self::ContactRebound => 0.1,
            Self::ContactTimeToRest => 0.2,
            Self::ThesisContact => 1e-4,
            Self::CameraDepths => 5e-3,
            Self::CameraColours => 1e-2,
            Self::UnitCamera
            | Self::ClosedLoopRpm
            | Self::ClosedLoopFlight
            | Self::RlRpm
            | Self::RlTask
            | Self::ThesisRpm
            | Self::ThesisTask => 1e-6,
            Self::OneStep
            | Self::OpenLoop
            | Self::ClosedLoopStates
            | Self::UnitAttitude
            | Self::UnitDslPid
            | Self::UnitConstants
            | Self::RlStates
            | Self::ThesisOneStep
            | Self::ThesisStates
            | Self::ForkStates
            | Self::ForkRpm
            | Self::ForkDslPid
            | Self::ForkSimplePid => 1e-9,
        }
    }
}

/// Greatest errors that pass.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerances(BTreeMap<Kind, f64>);

impl Default for Tolerances {
    fn default() -> Self {
        Self(Kind::ALL.into_iter().map(|kind| (kind, kind.default_tolerance())).collect())
    }
}

impl Tolerances {
    /// Sets the tolerance of the kind called `name`, or of all kinds `name.…`.
    ///
    /// # Errors
    /// The known names, if it is none of them.
    pub fn set(&mut self, name: &str, tolerance: f64) -> Result<(), String> {
        let meant = |kind: &Kind| kind.name().split('.').next() == Some(name) || kind.name() == name;
        let kinds: Vec<Kind> = Kind::ALL.into_iter().filter(meant).collect();
        if kinds.is_empty() {
            return Err(format!("expected one of {}", Kind::ALL.map(Kind::name).join(", ")));
        }
        for kind in kinds {
            self.0.insert(kind, tolerance);
        }
        Ok(())
    }

    fn of(&self, kind: Kind) -> f64 {
        self.0.get(&kind).copied().unwrap_or(kind.default_tolerance())
    }
}

/// The worst of the rows of one case.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Worst {
    rows: usize,
    error: f64,
    row: String,
}

impl Worst {
    /// Of rows that are judged together.
    pub(super) fn of(rows: usize, error: f64, row: impl fmt::Display) -> Self {
        Self { rows, error, row: row.to_string() }
    }

    /// Whether there was no row.
    pub(super) fn is_empty(&self) -> bool {
        self.rows == 0
    }

    /// One more row, which messages call `row`.
    pub(super) fn add(&mut self, error: f64, row: impl fmt::Display) {
        self.rows += 1;
        if error > self.error || self.rows == 1 {
            (self.error, self.row) = (error, row.to_string());
        }
    }
}

/// One line of the report.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What was compared.
    pub kind: Kind,
    /// Recorded runs or files.
    pub cases: usize,
    /// Recorded rows.
    pub rows: usize,
    /// Greatest absolute difference, in the units of the recording.
    pub error: f64,
    /// Case and row of that difference.
    pub worst: String,
    /// Greatest difference that passes.
    pub tolerance: f64,
}

impl Finding {
    /// Whether everything was within the tolerance.
    pub fn passed(&self) -> bool {
        self.error <= self.tolerance
    }
}

/// All findings, and what was left out and why.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// In the order of [`Kind`].
    pub findings: Vec<Finding>,
    /// Sentences.
    pub notes: Vec<String>,
}

impl Report {
    /// Whether everything was within its tolerance.
    pub fn passed(&self) -> bool {
        self.findings.iter().all(Finding::passed)
    }

    /// Rows that were compared.
    pub fn rows(&self) -> usize {
        self.findings.iter().map(|finding| finding.rows).sum()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let heading = ("kind", "cases", "rows", "worst error", "tolerance");
        let (kind, cases, rows, error, tolerance) = heading;
        write!(formatter, "{kind:<21} {cases:>6} {rows:>8} {error:>12} {tolerance:>10}       worst case")?;
        for finding in &self.findings {
            let Finding { kind, cases, rows, error, worst, tolerance } = finding;
            let verdict = if finding.passed() { "ok" } else { "FAIL" };
            let kind = kind.name();
            write!(
                formatter,
                "\n{kind:<21} {cases:>6} {rows:>8} {error:>12.1e} {tolerance:>10.0e}  {verdict:<4} {worst}"
            )?;
        }
        for note in &self.notes {
            write!(formatter, "\nnote: {note}")?;
        }
        Ok(())
    }
}

/// Findings as they come in.
#[derive(Debug)]
pub(super) struct Ledger {
    tolerances: Tolerances,
    findings: BTreeMap<Kind, Finding>,
    notes: Vec<String>,
}

impl Ledger {
    pub(super) fn new(tolerances: Tolerances) -> Self {
        Self { tolerances, findings: BTreeMap::new(), notes: Vec::new() }
    }

    /// One more case.
    pub(super) fn add(&mut self, kind: Kind, case: &str, worst: &Worst) {
        let tolerance = self.tolerances.of(kind);
        let empty = || Finding { kind, cases: 0, rows: 0, error: 0.0, worst: String::new(), tolerance };
        let finding = self.findings.entry(kind).or_insert_with(empty);
        finding.cases += 1;
        if worst.rows == 0 {
            self.notes.push(format!("{}: nothing in {case} can be compared", kind.name()));
            return;
        }
        if finding.rows == 0 || worst.error > finding.error {
            finding.error = worst.error;
            finding.worst = format!("{case}, {}", worst.row);
        }
        finding.rows += worst.rows;
    }

    /// Something that was left out.
    pub(super) fn note(&mut self, note: impl Into<String>) {
        self.notes.push(note.into());
    }

    pub(super) fn into_report(self) -> Report {
        Report { findings: self.findings.into_values().collect(), notes: self.notes }
    }
}
