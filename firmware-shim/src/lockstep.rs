//! The loop that flies vehicles in their plants: receive, tick, step, wait, over and over.

use std::fmt;
use std::str::FromStr;
use std::thread;
use std::time::{Duration, Instant};

use kestrel_core::vehicle::State;

use crate::autopilot::Mode;
use crate::battery::Battery;
use crate::controller::Controller;
use crate::crtp::link::CrtpLink;
use crate::flight_log::{FlightLog, FlightLogError};
use crate::link::{LinkError, Links, Peer};
use crate::persistent_store::{PersistentStore, PersistentStoreError};
use crate::plant::Plant;
use crate::policy_backend::PolicyBackend;
use crate::vehicle::{Punctuality, Vehicle};

/// A loop that lags farther behind the wall clock does not catch up \[s\]: the machine slept or is too slow.
const LAG_LIMIT: Duration = Duration::from_millis(250);

/// How often peers are heard between two control periods: their questions are answered within a millisecond, and what they
/// send does not fill the operating system's queue, of a few hundred datagrams.
const ATTENTION_PERIOD: Duration = Duration::from_micros(500);

/// How simulated time relates to the wall clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SimulationRate {
    /// So many simulated seconds in a second, above zero; 1 is real time.
    Speed(f64),
    /// As fast as it goes.
    Unthrottled,
}

/// What is no [`SimulationRate`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a factor of real time from 0.01 to 1000, or \"max\", found \"{0}\"")]
pub struct SimulationRateError(String);

impl FromStr for SimulationRate {
    type Err = SimulationRateError;

    fn from_str(text: &str) -> Result<Self, SimulationRateError> {
        if text == "max" {
            return Ok(Self::Unthrottled);
        }
        match text.parse() {
            Ok(speed) if (0.01..=1000.0).contains(&speed) => Ok(Self::Speed(speed)),
            Ok(_) | Err(_) => Err(SimulationRateError(text.to_owned())),
        }
    }
}

/// How well a flight kept its pace.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timing {
    /// Simulated time \[s\].
    pub simulated_secs: f64,
    /// By the wall clock \[s\].
    pub wall_secs: f64,
    /// Control periods.
    pub periods: u64,
    /// Those whose work was not done in their time.
    pub overruns: u64,
    /// How late control periods began, all together and the latest of them \[s\].
    pub late_secs: [f64; 2],
}

impl fmt::Display for Timing {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { simulated_secs, wall_secs, periods, overruns, late_secs: [late, latest] } = *self;
        let factor = simulated_secs / wall_secs;
        write!(formatter, "{simulated_secs:.1} s in {wall_secs:.1} s, {factor:.2} times real time")?;
        if late == 0.0 {
            return Ok(());
        }
        let mean_ms = 1e3 * late / periods.max(1) as f64;
        let latest_ms = 1e3 * latest;
        write!(
            formatter,
            "; periods late by {mean_ms:.2} ms, {latest_ms:.1} ms at most; {overruns} of {periods} overran"
        )
    }
}

/// One control period of a flight, after the vehicle decided and before the plant moves.
#[derive(Clone, Copy, Debug)]
pub struct ControlPeriod<'a> {
    /// Which of the vehicles that fly together, from 0.
    pub number: usize,
    /// Simulated time since the start \[s\].
    pub secs: f64,
    /// True state.
    pub state: &'a State<f32>,
    /// What the autopilot is doing.
    pub mode: Mode,
    /// Which controller flies, or is going to.
    pub controller: Controller,
    /// What the rotors are told \[rad/s\].
    pub rotor_targets: [f32; 4],
}

/// Whether a flight goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// It does.
    Fly,
    /// It ends here.
    End,
}

/// Why a flight was cut short.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// A link fails.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The flight log cannot be written.
    #[error(transparent)]
    Log(#[from] FlightLogError),
    /// What outlives the flight cannot be kept.
    #[error(transparent)]
    PersistentStore(#[from] PersistentStoreError),
}

/// One of the vehicles that fly together, and what belongs to it alone.
pub struct SimulatedVehicle<'a, P> {
    vehicle: &'a mut Vehicle<P>,
    plant: &'a mut dyn Plant,
    links: &'a mut Links,
    crtp: Option<&'a mut CrtpLink>,
    log: Option<&'a mut FlightLog>,
    store: Option<&'a mut PersistentStore>,
    /// Wall time of the last decision.
    latency: Duration,
    rotor_targets: [f32; 4],
}

/// Flies several vehicles in one thread until `watch`, which sees every control period of each of them in turn, ends the
/// flight of all. They share the clock of the first: all have its control period. Says how it kept its pace.
///
/// # Errors
/// If a link fails or a log cannot be written; the others end with it.
pub fn fly<P: PolicyBackend>(
    vehicles: &mut [SimulatedVehicle<'_, P>],
    pace: SimulationRate,
    watch: &mut dyn FnMut(&ControlPeriod) -> Next,
) -> Result<Timing, FlightError> {
    let Some(first) = vehicles.first() else { return Ok(Timing::default()) };
    let (start, start_secs) = (Instant::now(), first.vehicle.elapsed_secs());
    let mut clock = Clock::new(pace, first.vehicle.control_period());
    if let SimulationRate::Speed(speed) = pace {
        for simulated in vehicles.iter_mut() {
            simulated.vehicle.set_pace(speed as f32);
        }
    }
    while decide(vehicles, watch)? == Next::Fly {
        for simulated in vehicles.iter_mut() {
            simulated.plant.step(&simulated.rotor_targets);
            // An unthrottled flight repeats itself to the bit, telemetry included.
            if pace != SimulationRate::Unthrottled {
                simulated.vehicle.note_latency(simulated.latency.as_secs_f32());
                simulated.vehicle.note_punctuality(clock.recent);
            }
        }
        for simulated in vehicles.iter_mut() {
            simulated.plant.settle();
        }
        clock.wait_and(&mut |ahead_secs| {
            vehicles.iter_mut().try_for_each(|simulated| simulated.attend(ahead_secs))
        })?;
    }
    vehicles.iter_mut().try_for_each(SimulatedVehicle::finish)?;
    let simulated_secs = vehicles.first().map_or(0.0, |first| first.vehicle.elapsed_secs() - start_secs);
    Ok(Timing { simulated_secs, wall_secs: start.elapsed().as_secs_f64(), ..clock.timing })
}

/// One control period before the plants move.
fn decide<P: PolicyBackend>(
    vehicles: &mut [SimulatedVehicle<'_, P>],
    watch: &mut dyn FnMut(&ControlPeriod) -> Next,
) -> Result<Next, FlightError> {
    let mut next = Next::Fly;
    for (number, simulated) in vehicles.iter_mut().enumerate() {
        let period = simulated.decide(number)?;
        if watch(&period) == Next::End {
            next = Next::End;
        }
    }
    Ok(next)
}

impl<'a, P: PolicyBackend> SimulatedVehicle<'a, P> {
    /// A vehicle in its plant, heard and told through its links.
    pub fn new(vehicle: &'a mut Vehicle<P>, plant: &'a mut dyn Plant, links: &'a mut Links) -> Self {
        Self {
            vehicle,
            plant,
            links,
            crtp: None,
            log: None,
            store: None,
            latency: Duration::ZERO,
            rotor_targets: [0.0; 4],
        }
    }

    /// Heard and told by clients of a Crazyflie, too.
    #[must_use]
    pub fn with_crtp(self, crtp: Option<&'a mut CrtpLink>) -> Self {
        Self { crtp, ..self }
    }

    /// With a log of its frames.
    #[must_use]
    pub fn with_log(self, log: Option<&'a mut FlightLog>) -> Self {
        Self { log, ..self }
    }

    /// With a store of what outlives the flight.
    #[must_use]
    pub fn with_store(self, store: &'a mut PersistentStore) -> Self {
        Self { store: Some(store), ..self }
    }

    /// Receives and ticks.
    fn decide(&mut self, number: usize) -> Result<ControlPeriod<'_>, FlightError> {
        let Self { vehicle, plant, links, crtp, log, store, latency, rotor_targets } = self;
        let secs = vehicle.elapsed_secs();
        let begin = Instant::now();
        vehicle.note_ahead(0.0);
        if let Some(store) = store {
            store.begin_period(vehicle);
        }
        links.begin_period(secs, &mut |peer, datagram, answer| hear(vehicle, log, peer, datagram, answer))?;
        if let Some(crtp) = crtp {
            crtp.note_ranges(plant.ranges());
            crtp.exchange(vehicle, plant.state())?;
        }
        vehicle.tend_task(*plant);
        if let Some(remaining) = plant.battery() {
            vehicle.change_battery(Battery::left(remaining));
        }
        if vehicle.wants_ranges() {
            vehicle.note_ranges(plant.ranges());
        }
        let listeners = links.listeners();
        *rotor_targets = vehicle.tick(plant.known_state(), &listeners, &mut |peer, frame| {
            // All are told the same: the log has it once.
            if listeners.first() == Some(&peer) {
                note(log, secs, frame);
            }
            links.send_to(peer, frame);
        });
        links.flush();
        *latency = begin.elapsed();
        if let Some(log) = log {
            log.end_period(secs)?;
        }
        if let Some(store) = store {
            store.end_period(vehicle)?;
        }
        Ok(ControlPeriod {
            number,
            secs,
            state: plant.state(),
            mode: vehicle.mode(),
            controller: vehicle.active_controller(),
            rotor_targets: *rotor_targets,
        })
    }

    /// Hears what has arrived since, so long before the next control period \[s, simulated\].
    fn attend(&mut self, ahead_secs: f64) -> Result<(), FlightError> {
        let Self { vehicle, links, log, .. } = self;
        vehicle.note_ahead(ahead_secs);
        links.receive(&mut |peer, datagram, answer| hear(vehicle, log, peer, datagram, answer))?;
        Ok(())
    }

    fn finish(&mut self) -> Result<(), FlightError> {
        if let Some(log) = &mut self.log {
            log.finish()?;
        }
        if let Some(store) = &mut self.store {
            store.finish(self.vehicle)?;
        }
        Ok(())
    }
}

/// Has a vehicle do what a peer asks for, and answer.
fn hear<P: PolicyBackend>(
    vehicle: &mut Vehicle<P>,
    log: &mut Option<&mut FlightLog>,
    peer: Peer,
    datagram: &[u8],
    answer: &mut dyn FnMut(&[u8]),
) -> bool {
    let secs = vehicle.elapsed_secs();
    note(log, secs, datagram);
    vehicle.receive(peer, datagram, &mut |frame| {
        note(log, secs, frame);
        answer(frame);
    })
}

fn note(log: &mut Option<&mut FlightLog>, secs: f64, datagram: &[u8]) {
    if let Some(log) = log {
        log.note(secs, datagram);
    }
}

/// Keeps the loop from running ahead of the wall clock.
///
/// A period is due at a whole number of periods after the start, so that no rounding and no late awakening adds up.
#[derive(Debug)]
pub(crate) struct Clock {
    /// Wall time of a control period \[s\]; none if unthrottled.
    period_secs: Option<f64>,
    /// Simulated time of one \[s\].
    control_secs: f64,
    start: Instant,
    periods: u64,
    timing: Timing,
    /// When the last second began, and what the timing was then.
    last_second: (Instant, Timing),
    recent: Option<Punctuality>,
}

/// How often peers are told how the flight keeps its pace.
const SECOND: Duration = Duration::from_secs(1);

impl Clock {
    pub(crate) fn new(pace: SimulationRate, control_period: Duration) -> Self {
        let period_secs = match pace {
            SimulationRate::Speed(speed) => Some(control_period.as_secs_f64() / speed),
            SimulationRate::Unthrottled => None,
        };
        let (start, timing) = (Instant::now(), Timing::default());
        let control_secs = control_period.as_secs_f64();
        Self { period_secs, control_secs, start, periods: 0, timing, last_second: (start, timing), recent: None }
    }

    /// Waits for the next period.
    pub(crate) fn wait(&mut self) {
        let Some(period_secs) = self.period_secs else { return };
        thread::sleep(self.until_next(period_secs, Instant::now()));
    }

    /// The same, and does something now and then meanwhile, that is told how far off the period is \[s, simulated\].
    fn wait_and<E>(&mut self, attend: &mut dyn FnMut(f64) -> Result<(), E>) -> Result<(), E> {
        let Some(period_secs) = self.period_secs else { return Ok(()) };
        let speed = self.control_secs / period_secs;
        let begin = Instant::now();
        let wait = self.until_next(period_secs, begin);
        self.timing.periods += 1;
        self.timing.overruns += u64::from(wait.is_zero());
        let end = begin + wait;
        loop {
            let now = Instant::now();
            let left = end.saturating_duration_since(now);
            if left.is_zero() {
                let late_secs = (now - end).as_secs_f64();
                let [late, latest] = self.timing.late_secs;
                self.timing.late_secs = [late + late_secs, latest.max(late_secs)];
                self.look_back(now);
                return Ok(());
            }
            thread::sleep(left.min(ATTENTION_PERIOD));
            attend(speed * end.saturating_duration_since(Instant::now()).as_secs_f64())?;
        }
    }

    /// Looks at the last second, once it is over.
    fn look_back(&mut self, now: Instant) {
        let (since, before) = self.last_second;
        let secs = now.saturating_duration_since(since);
        if secs < SECOND {
            return;
        }
        let periods = (self.timing.periods - before.periods) as f64;
        let late_secs = self.timing.late_secs[0] - before.late_secs[0];
        self.recent = Some(Punctuality {
            real_time_factor: (periods * self.control_secs / secs.as_secs_f64()) as f32,
            late_secs: (late_secs / periods.max(1.0)) as f32,
            overruns: self.timing.overruns,
        });
        self.last_second = (now, self.timing);
    }

    /// How long to sleep until the next period.
    fn until_next(&mut self, period_secs: f64, now: Instant) -> Duration {
        self.periods += 1;
        let due = self.start + Duration::from_secs_f64(self.periods as f64 * period_secs);
        if now > due + LAG_LIMIT {
            (self.start, self.periods) = (now, 0);
        }
        due.saturating_duration_since(now)
    }
}

#[cfg(test)]
mod tests;
