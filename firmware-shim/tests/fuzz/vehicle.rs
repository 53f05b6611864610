//! A vehicle that hears nonsense in good frames, on the ground and in flight.

use kestrel_core::airframe::CF2X;
use kestrel_onboard::signature::{SignatureTime, SigningKey};
use kestrel_shim::autopilot::Mode;
use kestrel_shim::frame::Frames;
use kestrel_shim::goal::MovingGoal;
use kestrel_shim::parameter::table::Parameter;
use kestrel_shim::parameter::{ParameterValue, Parameters};
use kestrel_shim::plant::Plant;

use crate::effort::{self, Effort};
use crate::random::Random;
use crate::request::{Request, Requests};
use crate::rig::Rig;

const REQUESTS: u64 = 200_000;

/// Requests between two attempts to get into the air, and there into the offboard mode.
const ATTEMPT: u64 = 8;

/// Requests between two missions.
const MISSION: u64 = 400;

/// Requests that one vehicle hears: some that empty its battery keep it on the ground.
const LIFE: u64 = 2000;

/// A drone whose motors stop as landed is no higher than this \[m\].
const FLOOR_M: f32 = 0.1;

/// Parameters of a command that chooses the offboard mode.
const OFFBOARD: [f32; 7] = [129.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Of `FD_ACTION`: stop the motors of a drone that is upset.
const STOP: ParameterValue = ParameterValue::Integer(3);

#[test]
fn no_request_panics_arms_by_itself_stops_a_motor_or_drives_one_beyond_its_limits() {
    torment(None, "requests");
}

#[test]
fn nor_does_one_that_is_signed_or_not() {
    torment(Some(&SigningKey([7; 32])), "requests to a vehicle that wants signatures");
}

/// Flies one vehicle after the other.
fn torment(key: Option<&SigningKey>, kind: &str) {
    let count = effort::number("FUZZ_REQUESTS", REQUESTS) / 2;
    let mut random = Random::new(effort::seed());
    let mut requests = Requests::new(random.next(), key.cloned());
    let mut trial = Trial::new();
    let mut now = SignatureTime(0);
    let effort = Effort::begin();
    for number in 0..count {
        if number % LIFE == 0 {
            trial.rig = key.map_or_else(Rig::new, |key| Rig::signing(key, now));
        }
        if number % ATTEMPT == 0 {
            trial.get_going(&mut requests);
        }
        if number % MISSION == 0 {
            trial.fly_mission(&mut requests, 1 + random.below(6) as u8);
        }
        trial.receive(requests.any());
        now = requests.now();
        for _ in 0..periods(&mut random) {
            trial.tick();
        }
    }
    effort.end(count, kind);
    trial.report();
}

/// Control periods until the next request: mostly none or one, seldom seconds.
fn periods(random: &mut Random) -> usize {
    match random.below(2000) {
        0 => random.below(1500),
        1..=500 => 1,
        _ => 0,
    }
}

/// What a request may change at once.
#[derive(Clone, Debug, PartialEq)]
struct Snapshot {
    mode: Mode,
    goal: MovingGoal,
    parameters: Parameters,
    unanswered: u64,
}

/// A vehicle under suspicion.
struct Trial {
    rig: Rig,
    limit: f32,
    /// An acknowledgement that must come with the next tick.
    armed_by_command: bool,
    /// Control periods in each mode.
    periods: [u64; Mode::ALL.len()],
    flights: u64,
    /// Items of missions that were reached.
    reached: u64,
    /// Values of parameters that were told.
    values: u64,
    sent: u64,
}

impl Trial {
    fn new() -> Self {
        let limit = CF2X.rotor_speed_limit as f32 * 1.000_001;
        Self {
            rig: Rig::new(),
            limit,
            armed_by_command: false,
            periods: [0; Mode::ALL.len()],
            flights: 0,
            reached: 0,
            values: 0,
            sent: 0,
        }
    }

    fn snapshot(&self) -> Snapshot {
        let vehicle = &self.rig.vehicle;
        Snapshot {
            mode: vehicle.mode(),
            goal: *vehicle.goal(),
            parameters: vehicle.parameters().clone(),
            unanswered: vehicle.counts().unanswered,
        }
    }

    fn get_going(&mut self, requests: &mut Requests) {
        match self.rig.vehicle.mode() {
            Mode::Disarmed => self.receive(requests.command(400, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])),
            Mode::Armed | Mode::Landed => self.receive(requests.command(22, [f32::NAN; 7])),
            // Refused as long as no set-points arrive, among all that arrives.
            Mode::Holding | Mode::Guided => self.receive(requests.command(176, OFFBOARD)),
            Mode::TakingOff | Mode::Offboard | Mode::Returning | Mode::Landing => {}
        }
    }

    /// Uploads a mission and starts it.
    fn fly_mission(&mut self, requests: &mut Requests, items: u8) {
        self.receive(requests.count(items));
        for sequence in 0..items {
            self.receive(requests.item(sequence));
        }
        self.receive(requests.command(300, [0.0; 7]));
    }

    fn receive(&mut self, request: &Request) {
        let before = self.snapshot();
        self.rig.receive(&request.datagram);
        let after = self.snapshot();
        assert!(request.admissible || before == after, "{request:02x?} was none of its business, {after:?}");
        if after.mode.armed() && !before.mode.armed() {
            assert!(request.arms, "{request:02x?} armed it");
            self.armed_by_command = after.unanswered == before.unanswered;
        }
        if before.mode.flies() && !after.mode.flies() {
            assert!(request.stops, "{request:02x?} stopped the motors");
        }
        self.flights += u64::from(after.mode.flies() && !before.mode.flies());
        assert!(after.goal.position().iter().all(|coordinate| coordinate.is_finite()), "{request:02x?}");
    }

    fn tick(&mut self) {
        let before = self.rig.vehicle.mode();
        let height_m = self.rig.plant.state().position.z;
        let mut acknowledged = false;
        let (reached, values, sent) = (&mut self.reached, &mut self.values, &mut self.sent);
        let targets = self.rig.tick(&mut |bytes| {
            let mut frames = Frames::new(bytes);
            let frame = frames.next().expect("one").expect("a good frame");
            assert!(frames.next().is_none());
            // COMMAND_ACK of an arming that was accepted.
            acknowledged |= frame.message_id == 77 && frame.fields::<3>() == [0x90, 0x01, 0];
            *reached += u64::from(frame.message_id == 46);
            *values += u64::from(frame.message_id == 22);
            *sent += 1;
        });
        let after = self.rig.vehicle.mode();
        self.check_mode(before, after, height_m);
        assert!(acknowledged || !self.armed_by_command, "armed without a word");
        self.armed_by_command = false;
        assert!(targets.iter().all(|target| (0.0..=self.limit).contains(target)), "{targets:?}");
        assert!(after.flies() || targets == [0.0; 4], "{after:?}: {targets:?}");
        // A mission may take off again in the period in which the drone has landed.
        let turning = targets.iter().all(|target| *target > 0.0);
        let flown_on = before.flies() && after.flies() && height_m >= FLOOR_M;
        assert!(!flown_on || turning, "{after:?} at {height_m} m: {targets:?}");
        self.periods[after as usize] += 1;
    }

    /// What may happen by itself.
    fn check_mode(&self, before: Mode, after: Mode, height_m: f32) {
        assert!(before.armed() || !after.armed(), "armed by itself");
        // A mission that is flown takes off by itself.
        assert!(!after.flies() || before.armed());
        if before.flies() && after == Mode::Landed {
            assert!(height_m < FLOOR_M, "landed at {height_m} m");
        }
        if before.flies() && after == Mode::Disarmed {
            let action = self.rig.vehicle.parameters().get(Parameter::FdAction);
            assert_eq!(action, STOP, "motors stopped at {height_m} m");
        }
    }

    /// Says that it was no trial on the ground only.
    fn report(&self) {
        let Self { flights, reached, values, sent, .. } = self;
        for (mode, periods) in Mode::ALL.into_iter().zip(self.periods) {
            print!("  {} {periods},", mode.name());
            assert!(periods > 0, "never {}", mode.name());
        }
        println!(" in control periods; {flights} flights, {sent} frames sent");
        println!("  {reached} items of missions were reached, {values} values of parameters told");
        assert!(*reached > 0 && *values > 0);
    }
}
