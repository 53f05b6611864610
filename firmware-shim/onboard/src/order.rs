//! What a command of a peer means to an autopilot.

use crate::acknowledgement::{CommandAnswer, CommandResult};
use crate::autopilot::{ALTITUDES_M, Autopilot, Command, Mode, Refusal};
use crate::controller::Controller;
use crate::flight_mode::FlightMode;
use crate::geodesy::Home;
use crate::policy_backend::PolicyBackend;
use crate::request::CommandRequest;

/// Second parameter of a disarm command that shall work in flight (`MAV_CMD_COMPONENT_ARM_DISARM`).
const FORCED: f32 = 21196.0;

/// Points farther than this from the origin along an axis are refused \[m\], as those of set-points are.
const COORDINATE_LIMIT_M: f32 = 1000.0;

/// What an autopilot is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// Execute a command.
    Execute(Command),
    /// Have the policy or the cascade fly, and hold if it does anything else.
    SelectController(Controller),
    /// Hold in flight; on the ground that is what it does.
    Hold,
    /// Fly the mission that was uploaded, where one can be.
    Mission,
}

const UNKNOWN_MODE: CommandAnswer = CommandAnswer::denied("mode refused: unknown, see AVAILABLE_MODES");
const UNKNOWN_PARAMETER: CommandAnswer = CommandAnswer::denied("command refused: unknown parameter 1");
const UNSUPPORTED: CommandAnswer =
    CommandAnswer { result: CommandResult::Unsupported, text: Some("this command is not supported") };

impl Order {
    /// What a request orders an autopilot to do, in a world whose origin is at `origin`.
    ///
    /// # Errors
    /// Why it is no order.
    pub fn of<P: PolicyBackend>(
        request: &CommandRequest,
        autopilot: &Autopilot<P>,
        origin: &Home,
    ) -> Result<Self, CommandAnswer> {
        let [first, second, third, _] = request.parameters;
        match request.command {
            17 => Ok(Self::Execute(Command::Pause)),
            20 => Ok(Self::Execute(Command::Return)),
            21 if request.place.is_here() => Ok(Self::Execute(Command::Land)),
            22 if request.place.is_here() => Ok(take_off(request.place.height(), autopilot, origin)),
            21 | 22 => Err(CommandAnswer::denied("refused: takes off and lands in place")),
            176 => Self::to_mode(FlightMode::of_numbers(second, third), autopilot, origin),
            178 => Ok(Self::Execute(Command::Speed(second))),
            185 if first > 0.5 => Ok(Self::Execute(Command::StopMotors)),
            192 => reposition(request, autopilot, origin),
            193 if first == 0.0 => Ok(Self::Execute(Command::Pause)),
            193 if first == 1.0 => Ok(Self::Mission),
            300 => Ok(Self::Mission),
            400 => arm_or_disarm(first, second),
            185 | 193 => Err(UNKNOWN_PARAMETER),
            _ => Err(UNSUPPORTED),
        }
    }

    /// What the change to a mode orders an autopilot to do, in a world whose origin is at `origin`.
    ///
    /// # Errors
    /// If there is no such mode.
    pub fn to_mode<P: PolicyBackend>(
        mode: Option<FlightMode>,
        autopilot: &Autopilot<P>,
        origin: &Home,
    ) -> Result<Self, CommandAnswer> {
        Ok(match mode.ok_or(UNKNOWN_MODE)? {
            FlightMode::Policy => Self::SelectController(Controller::Policy),
            FlightMode::Cascade => Self::SelectController(Controller::Cascade),
            FlightMode::Hold | FlightMode::Position => Self::Hold,
            FlightMode::Offboard => Self::Execute(Command::Offboard),
            FlightMode::TakeOff => take_off(f32::NAN, autopilot, origin),
            FlightMode::Land => Self::Execute(Command::Land),
            FlightMode::Return => Self::Execute(Command::Return),
            FlightMode::Mission => Self::Mission,
        })
    }

    /// Executes it in a mode by commands, one after the other until one is refused.
    ///
    /// # Errors
    /// The refusal; a mission is refused, for it is more than commands.
    pub fn execute(
        self,
        mode: Mode,
        command: &mut dyn FnMut(Command) -> Result<(), Refusal>,
    ) -> Result<(), Refusal> {
        match self {
            Self::Execute(only) => return command(only),
            Self::SelectController(controller) => command(Command::SelectController(controller))?,
            Self::Hold => {}
            Self::Mission => return Err(Refusal::NoMission),
        }
        if mode.flies() { command(Command::Pause) } else { Ok(()) }
    }
}

fn arm_or_disarm(first: f32, second: f32) -> Result<Order, CommandAnswer> {
    if first == 1.0 {
        Ok(Order::Execute(Command::Arm))
    } else if first == 0.0 && second == FORCED {
        Ok(Order::Execute(Command::StopMotors))
    } else if first == 0.0 {
        Ok(Order::Execute(Command::Disarm))
    } else {
        Err(UNKNOWN_PARAMETER)
    }
}

/// Climbs by a height \[m\]. Ground stations mean one above the ground or one above sea level; what can be the former is.
fn take_off<P: PolicyBackend>(height: f32, autopilot: &Autopilot<P>, origin: &Home) -> Order {
    let above_origin = (f64::from(height) - origin.altitude_m) as f32;
    let altitude_m = if height.is_nan() {
        autopilot.settings().takeoff_altitude_m
    } else if !ALTITUDES_M.contains(&height) && ALTITUDES_M.contains(&above_origin) {
        above_origin
    } else {
        height
    };
    Order::Execute(Command::TakeOff { altitude_m })
}

/// `MAV_CMD_DO_REPOSITION`: there, at the present height if it is left open.
fn reposition<P: PolicyBackend>(
    request: &CommandRequest,
    autopilot: &Autopilot<P>,
    origin: &Home,
) -> Result<Order, CommandAnswer> {
    let goal = autopilot.goal().position();
    let place = request.place.point(origin);
    let mut point = place.ok_or(CommandAnswer::denied("refused: no place on Earth, or unknown frame"))?;
    if point.z.is_nan() {
        point.z = goal.z;
    }
    if request.place.is_here() {
        (point.x, point.y) = (goal.x, goal.y);
    }
    let beyond = |coordinate: &f32| coordinate.is_nan() || coordinate.abs() > COORDINATE_LIMIT_M;
    if point.iter().any(beyond) || point.z < 0.0 {
        return Err(CommandAnswer::denied("refused: under the floor or over 1 km away"));
    }
    Ok(Order::Execute(Command::GoTo(point)))
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::CF2X;

    use super::*;
    use crate::request::CommandLocation;
    use crate::testing::{hover_policy, pilot};

    fn order(command: u16, parameters: [f32; 4], place: CommandLocation) -> Result<Order, CommandAnswer> {
        let autopilot = Autopilot::new(pilot(hover_policy()), &CF2X);
        let request = CommandRequest { command, confirmation: 0, parameters, place };
        Order::of(&request, &autopilot, &Home::default())
    }

    fn in_place(command: u16, parameters: &[f32]) -> Result<Order, CommandAnswer> {
        let parameters = core::array::from_fn(|i| parameters.get(i).copied().unwrap_or(f32::NAN));
        order(command, parameters, CommandLocation::Floats([f32::NAN; 3]))
    }

    #[test]
    fn commands_mean_what_the_protocol_says() {
        let cases = [
            (400, &[1.0][..], Command::Arm),
            (400, &[0.0], Command::Disarm),
            (400, &[0.0, FORCED], Command::StopMotors),
            (185, &[1.0], Command::StopMotors),
            (21, &[], Command::Land),
            (22, &[], Command::TakeOff { altitude_m: 1.0 }),
            (20, &[], Command::Return),
            (17, &[], Command::Pause),
            (193, &[0.0], Command::Pause),
            (176, &[1.0, 6.0, 0.0], Command::Offboard),
            (176, &[1.0, 4.0, 6.0], Command::Land),
            (178, &[1.0, 0.3], Command::Speed(0.3)),
        ];
        for (command, parameters, expected) in cases {
            assert_eq!(in_place(command, parameters), Ok(Order::Execute(expected)), "{command} {parameters:?}");
        }
        assert_eq!(in_place(176, &[1.0, 4.0, 12.0]), Ok(Order::SelectController(Controller::Cascade)));
        assert_eq!(in_place(300, &[]), Ok(Order::Mission));
    }

    #[test]
    fn a_take_off_climbs_by_a_height_above_ground_or_to_one_above_sea_level() {
        let above_sea_level = (Home::default().altitude_m + 1.5) as f32;
        for height in [1.5, above_sea_level] {
            let take_off = order(22, [f32::NAN; 4], CommandLocation::Floats([f32::NAN, f32::NAN, height]));
            assert_eq!(take_off, Ok(Order::Execute(Command::TakeOff { altitude_m: 1.5 })));
        }
    }

    #[test]
    fn nonsense_is_no_order() {
        for (command, parameters) in [(400, [f32::NAN]), (400, [2.0]), (185, [f32::NAN]), (193, [0.5])] {
            assert_eq!(in_place(command, &parameters), Err(UNKNOWN_PARAMETER));
        }
        assert_eq!(in_place(176, &[1.0, f32::NAN, 0.0]), Err(UNKNOWN_MODE));
        assert_eq!(in_place(65_535, &[]), Err(UNSUPPORTED));
        let under_the_floor = CommandLocation::Integers { frame: 1, integers: [10_000, 0], height: 0.1 };
        assert_eq!(order(192, [0.0; 4], under_the_floor).unwrap_err().result, CommandResult::Denied);
        let far = CommandLocation::Floats([47.0, 8.0, 500.0]);
        for command in [21, 22, 192] {
            assert_eq!(order(command, [0.0; 4], far).unwrap_err().result, CommandResult::Denied);
        }
    }

    /// The commands of an order, none of which is refused.
    fn commands(order: Order, mode: Mode) -> Vec<Command> {
        let mut commands = Vec::new();
        let outcome = order.execute(mode, &mut |command| {
            commands.push(command);
            Ok(())
        });
        assert_eq!(outcome, Ok(()));
        commands
    }

    #[test]
    fn another_controller_takes_over_and_holds_in_flight_only() {
        let select = Command::SelectController(Controller::Policy);
        assert_eq!(commands(Order::SelectController(Controller::Policy), Mode::Armed), [select]);
        let in_flight = commands(Order::SelectController(Controller::Policy), Mode::Returning);
        assert_eq!(in_flight, [select, Command::Pause]);
        assert_eq!(commands(Order::Hold, Mode::Disarmed), []);
        assert_eq!(commands(Order::Hold, Mode::Guided), [Command::Pause]);
    }

    #[test]
    fn after_a_refusal_nothing_more_is_commanded() {
        let mut count = 0;
        let outcome = Order::SelectController(Controller::Policy).execute(Mode::Returning, &mut |_| {
            count += 1;
            Err(Refusal::SelfTest)
        });
        assert_eq!((outcome, count), (Err(Refusal::SelfTest), 1));
        assert_eq!(Order::Mission.execute(Mode::Holding, &mut |_| Ok(())), Err(Refusal::NoMission));
    }
}
