//! The pilots that come with the program: those of `assets/pilots`, by name.

/// Names and policy files, in fixed point.
const PILOTS: [(&str, &[u8]); 4] = [
    ("cross", include_bytes!("../../assets/pilots/cross.kestrel")),
    ("hover", include_bytes!("../../assets/pilots/hover.kestrel")),
    ("hover-2-1-plus", include_bytes!("../../assets/pilots/hover-2-1-plus.kestrel")),
    ("hover-cf2x", include_bytes!("../../assets/pilots/hover-cf2x.kestrel")),
];

/// The policy file of a pilot.
pub(crate) fn pilot(name: &str) -> Option<&'static [u8]> {
    PILOTS.iter().find(|(shipped, _)| *shipped == name).map(|(_, file)| *file)
}

/// All names, for messages.
pub(crate) fn names() -> String {
    PILOTS.map(|(name, _)| name).join(", ")
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::{Airframe, CF2X, CRAZYFLIE_2_1, CRAZYFLIE_2_1_PLUS};
    use kestrel_core::policy_file::PolicyAirframe;
    use kestrel_export::policy::Policy;
    use kestrel_shim::policy_bytes::PolicyBytes;

    use super::*;

    #[test]
    fn every_pilot_knows_its_drone() {
        let drones: [(&str, &Airframe); 4] = [
            ("cross", &CF2X),
            ("hover", &CRAZYFLIE_2_1),
            ("hover-2-1-plus", &CRAZYFLIE_2_1_PLUS),
            ("hover-cf2x", &CF2X),
        ];
        assert_eq!(drones.map(|(name, _)| name), PILOTS.map(|(name, _)| name));
        for (name, drone) in drones {
            let file = PolicyBytes::copy_of(pilot(name).unwrap());
            let policy = Policy::parse(file.bytes()).unwrap();
            assert_eq!(policy.metadata().airframe, Some(PolicyAirframe::from(drone)), "{name}");
            policy.self_test().unwrap();
        }
    }
}
