//! What an app for a Crazyflie measures for a policy: C of its rangers, and of the rooms in which it casts the beams of a scan.

use std::fmt::Write;

use kestrel_core::scan::ScanMap;
use kestrel_sim::contact::ScanMaps;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::sensor::instrument::Instrument;
use kestrel_sim::sensor::signal::{Direction, Signal};
use kestrel_sim::sensor::{SensorSuite, Told};

use super::{SourceError, comment, rows};

/// Most rooms: the app counts them in eight bits.
const ROOM_LIMIT: usize = 255;

/// Words of a `KestrelMap` on a microcontroller.
const MAP_WORDS: usize = 12;

/// What is measured for a policy in its tasks.
#[derive(Debug)]
pub(super) struct Sensing {
    rangers: Vec<(Direction, f64)>,
    /// Names of the tasks, and maps of their rooms.
    rooms: Option<(Vec<String>, ScanMaps)>,
}

impl Sensing {
    /// For a policy that sees `measured_len` values in these tasks, by their names.
    ///
    /// # Errors
    /// [`SourceError`], when a Crazyflie does not measure them.
    pub(super) fn new(measured_len: usize, tasks: &[(&str, &Scenario)]) -> Result<Self, SourceError> {
        if measured_len == 0 {
            return Ok(Self { rangers: Vec::new(), rooms: None });
        }
        let [(_, first), others @ ..] = tasks else { return Err(SourceError::UnknownSensors) };
        let suite = &first.sensors;
        let other = |found: &str| Err(SourceError::Sensors { found: found.to_owned() });
        if let Some((name, _)) = others.iter().find(|(_, scenario)| scenario.sensors != *suite) {
            return other(&format!("the sensors of {} otherwise in {}", tasks[0].0, comment(name)));
        }
        if let Some(told) = suite.told() {
            return other(name_of_told(told));
        }
        if suite.tof().is_some() {
            return other("a `tof`: the app asks for none");
        }
        if suite.len() != measured_len {
            return other(&format!("{measured_len} values, where its task measures {}", suite.len()));
        }
        let rangers = suite.instruments().iter().map(ranger).collect::<Result<_, _>>()?;
        Ok(Self { rangers, rooms: rooms(suite, tasks)? })
    }

    /// How many values a policy sees.
    fn len(&self) -> usize {
        self.rangers.len() + self.rooms.as_ref().map_or(0, |(_, maps)| maps.map(0).per_descent.len())
    }

    /// Flash that the maps take \[bytes\].
    pub(super) fn map_bytes(&self) -> usize {
        let Some((_, maps)) = &self.rooms else { return 0 };
        let shared = maps.map(0);
        let rooms = (0..maps.len()).map(|index| {
            let ScanMap { per_descent, slabs, bodies, .. } = maps.map(index);
            size_of_val(per_descent) + size_of_val(slabs) + size_of_val(bodies) + MAP_WORDS * size_of::<u32>()
        });
        let of_normals = size_of_val(shared.normals) + size_of_val(shared.per_metre) + size_of_val(shared.sides);
        of_normals + rooms.sum::<usize>()
    }

    /// What the header says of them; nothing without sensors.
    pub(super) fn header(&self) -> String {
        let Self { rangers, rooms } = self;
        let mut text = String::new();
        if self.len() == 0 {
            return text;
        }
        let _infallible = writeln!(
            text,
            "\n#include \"kestrel.h\"\n\n/* What the policy sees beside the drone's motion: rangers first, then the beams of a scan. */\n#define KESTREL_MEASUREMENTS {}",
            self.len()
        );
        if !rangers.is_empty() {
            let names = rangers.iter().map(|(direction, _)| format!("\"{}\"", name_of(*direction)));
            let limits = rangers.iter().map(|(_, limit)| format!("{limit:?}f"));
            let _infallible = writeln!(
                text,
                "\n/* Log variables of the group `range` in the policy's order, and what is farther reads as this far [m]. */\n#define KESTREL_RANGERS {}\n#define KESTREL_RANGER_NAMES {}\n#define KESTREL_RANGER_LIMITS {}",
                rangers.len(),
                names.collect::<Vec<_>>().join(", "),
                limits.collect::<Vec<_>>().join(", ")
            );
        }
        if let Some((names, _)) = rooms {
            let list =
                names.iter().enumerate().map(|(number, name)| format!("\n *   {number:3} {}", comment(name)));
            let _infallible = writeln!(
                text,
                "\n/* Rooms in whose maps the beams are cast, by the app's parameter `room`:{}\n */\n#define KESTREL_ROOMS {}\nextern const KestrelMap kestrel_rooms[KESTREL_ROOMS];",
                list.collect::<String>(),
                names.len()
            );
        }
        text
    }

    /// The maps in C; nothing without rooms.
    pub(super) fn source(&self) -> String {
        let Some((names, maps)) = &self.rooms else { return String::new() };
        let all: Vec<ScanMap<'_>> = (0..maps.len()).map(|index| maps.map(index)).collect();
        let shared = &all[0];
        let mut text = format!(
            "
/* Unit normals of slabs, world. */
static const float NORMALS[{}][3] = {{{}
}};

/* For each normal, for each beam: metres along the beam for a metre along the normal. */
static const float PER_METRE[{}] = {{{}
}};

/* For each normal, a bit for each beam that goes along it, and for each that goes against it. */
static const uint64_t SIDES[{}][2] = {{{}
}};
",
            shared.normals.len().max(1),
            rows(
                or_zero(
                    shared.normals.iter().map(|[x, y, z]| format!("{{{x:?}f, {y:?}f, {z:?}f}}")),
                    "{0.0f, 0.0f, 0.0f}"
                ),
                3
            ),
            shared.per_metre.len().max(1),
            rows(or_zero(shared.per_metre.iter().map(|value| format!("{value:?}f")), "0.0f"), 8),
            shared.sides.len().max(1),
            rows(
                or_zero(
                    shared.sides.iter().map(|[along, against]| format!("{{{along:#x}, {against:#x}}}")),
                    "{0, 0}"
                ),
                4
            ),
        );
        for (index, (name, map)) in names.iter().zip(&all).enumerate() {
            text += &room_source(index, name, map);
        }
        text += "\nconst KestrelMap kestrel_rooms[KESTREL_ROOMS] = {";
        for (index, map) in all.iter().enumerate() {
            let _infallible = write!(
                text,
                "\n    {{{:?}f, {:?}f, {}, DESCENT_{index}, {}, NORMALS, PER_METRE, SIDES, {}, SLABS_{index}, {}, BODIES_{index}}},",
                map.limit,
                map.near_scale.unwrap_or_default(),
                map.per_descent.len(),
                map.normals.len(),
                map.slabs.len(),
                map.bodies.len(),
            );
        }
        text + "\n};\n"
    }
}

/// What stands in a room.
fn room_source(index: usize, name: &str, map: &ScanMap<'_>) -> String {
    let slab = |slab: &kestrel_core::scan::Slab| format!("{{{}, {:?}f, {:?}f}}", slab.normal, slab.low, slab.high);
    format!(
        "
/* {}: what the floor is to each beam, slabs body by body (normal, low, high), and how many each body has. */
static const float DESCENT_{index}[{}] = {{{}
}};
static const KestrelSlab SLABS_{index}[{}] = {{{}
}};
static const uint32_t BODIES_{index}[{}] = {{{}
}};
",
        comment(name),
        map.per_descent.len(),
        rows(map.per_descent.iter().map(|value| format!("{value:?}f")), 8),
        map.slabs.len().max(1),
        rows(or_zero(map.slabs.iter().map(slab), "{0, 0.0f, 0.0f}"), 4),
        map.bodies.len().max(1),
        rows(or_zero(map.bodies.iter().map(u32::to_string), "0"), 16),
    )
}

/// The values, or a zero that nothing reads: C has no empty arrays.
fn or_zero(values: impl Iterator<Item = String>, zero: &str) -> impl Iterator<Item = String> {
    let mut values = values.peekable();
    let none = values.peek().is_none().then(|| zero.to_owned());
    values.chain(none)
}

/// Where a ranger looks, and how far \[m\].
fn ranger(instrument: &Instrument) -> Result<(Direction, f64), SourceError> {
    let other = |found: &str| Err(SourceError::Sensors { found: found.to_owned() });
    match instrument.signal {
        Signal::Distance { direction, limit } if instrument.unit == 1.0 => Ok((direction, limit)),
        Signal::Distance { .. } => other("a ranger that does not read in metres"),
        Signal::BodyRates => other("a gyroscope"),
        Signal::SpecificForce => other("an accelerometer"),
        Signal::Flow { .. } => other("the flow of the ground"),
        Signal::Height => other("a barometer"),
    }
}

/// What a drone is told rather than measures.
const fn name_of_told(told: &Told) -> &'static str {
    match told {
        Told::Mates(_) => "its team mates",
        Told::Path(_) => "the path ahead",
        Told::Coverage(_) => "which cells it has visited",
        Told::Gates(_) => "the next gates",
        Told::Way(_) => "the way through its own map",
    }
}

/// The log variable of the group `range`.
const fn name_of(direction: Direction) -> &'static str {
    match direction {
        Direction::Front => "front",
        Direction::Back => "back",
        Direction::Left => "left",
        Direction::Right => "right",
        Direction::Up => "up",
        Direction::Down => "zrange",
    }
}

/// Maps of the rooms, where there is a scan.
fn rooms(
    suite: &SensorSuite,
    tasks: &[(&str, &Scenario)],
) -> Result<Option<(Vec<String>, ScanMaps)>, SourceError> {
    let Some(scan) = suite.scan() else { return Ok(None) };
    let other = |found: String| Err(SourceError::Sensors { found });
    if scan.sweeps {
        return other("beams that sweep".to_owned());
    }
    if tasks.len() > ROOM_LIMIT {
        return other(format!("a scan of {} rooms, {ROOM_LIMIT} at most", tasks.len()));
    }
    for (name, scenario) in tasks {
        if scenario.drawn.is_some() {
            return other(format!("a scan of rooms that are drawn anew ({})", comment(name)));
        }
        if !scenario.aviary.world.movables.is_empty() {
            return other(format!("a scan of what moves ({})", comment(name)));
        }
    }
    let maps = ScanMaps::new(tasks.iter().map(|(_, scenario)| &scenario.aviary.world), scan);
    Ok(Some((tasks.iter().map(|(name, _)| (*name).to_owned()).collect(), maps)))
}
