//! An identified airframe as a YAML file, in the form of `assets/airframes`.

use std::fmt::Write;

use kestrel_core::airframe::{Airframe, Layout, RADIANS_PER_SECOND_PER_RPM, RotorOrder};

use crate::identification::{Finding, Identification, Verdict};

/// \[N s²/rad²\] of \[N/RPM²\], and of torques likewise, when multiplied.
const PER_RPM_SQUARED: f64 = RADIANS_PER_SECOND_PER_RPM * RADIANS_PER_SECOND_PER_RPM;

/// Width of the comment.
const WIDTH: usize = 118;

/// The file: `sources` say in a comment where its numbers come from, beside their 95 % intervals.
pub fn airframe_file(identification: &Identification, sources: &[String]) -> String {
    let mut text = String::from("# An airframe that `kestrel identify` found in flights.\n#\n");
    for source in sources {
        comment(&mut text, source);
    }
    text.push_str("#\n# 95 % intervals:\n");
    for finding in &identification.findings {
        comment(&mut text, &line(finding));
    }
    text.push_str("#\n#   vehicle: { airframe: { import: THIS FILE } }\n\n");
    text.push_str(&numbers(&identification.drone.airframe));
    text
}

fn comment(text: &mut String, sentence: &str) {
    let mut line = "#".to_owned();
    for word in sentence.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() > WIDTH {
            text.push_str(&line);
            text.push('\n');
            "#".clone_into(&mut line);
        }
        line.push(' ');
        line.push_str(word);
    }
    text.push_str(&line);
    text.push('\n');
}

fn line(finding: &Finding) -> String {
    let (name, unit) = (finding.parameter.name(), finding.parameter.unit());
    match (finding.verdict, finding.interval()) {
        (Verdict::Told(_), Some([low, high])) => format!("{name}: {} to {} {unit}", digits(low), digits(high)),
        (Verdict::Told(_) | Verdict::Kept(_), _) => format!("{name}: kept at {} {unit}", digits(finding.value)),
    }
}

/// Four significant digits: more than any flight tells.
pub(crate) fn digits(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let exponent = value.abs().log10().floor() as i32;
    if (-3..5).contains(&exponent) {
        let decimals = (3 - exponent).max(0) as usize;
        let text = format!("{value:.decimals$}");
        return if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        };
    }
    let text = format!("{value:.3e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    format!("{}e{exponent}", mantissa.trim_end_matches('0').trim_end_matches('.'))
}

fn numbers(airframe: &Airframe) -> String {
    let mut text = String::new();
    let three = |values: [f64; 3]| format!("[{}]", values.map(digits).join(", "));
    let layout = match airframe.layout {
        Layout::Cross { x, y } => format!("{{ cross: {{ x_m: {x}, y_m: {y} }} }}"),
        Layout::Plus { arm } => format!("{{ plus: {{ arm_m: {arm} }} }}"),
    };
    let order = match airframe.rotor_order {
        RotorOrder::Clockwise => "clockwise",
        RotorOrder::CounterClockwise => "counter_clockwise",
    };
    let (drag, downwash, effects) = (&airframe.drag_coefficients, &airframe.downwash, &airframe.effects);
    let lines = [
        ("mass_kg", digits(airframe.mass)),
        ("inertia_kg_m2", three(airframe.inertia)),
        ("layout", layout),
        ("rotor_order", order.to_owned()),
        ("arm_m", digits(airframe.arm)),
        ("thrust_n_per_rpm2", digits(airframe.thrust_coefficient * PER_RPM_SQUARED)),
        ("torque_nm_per_rpm2", digits(airframe.torque_coefficient * PER_RPM_SQUARED)),
        ("rotor_speed_limit_rpm", digits(airframe.rotor_speed_limit / RADIANS_PER_SECOND_PER_RPM)),
        ("rotor_rise_secs", digits(airframe.rotor_rise_secs)),
        ("rotor_fall_secs", digits(airframe.rotor_fall_secs)),
        ("drag_planar_kg_per_rad", digits(drag.planar)),
        ("drag_axial_kg_per_rad", digits(drag.axial)),
        ("propeller_radius_m", airframe.propeller_radius.to_string()),
        ("ground_effect_coefficient", airframe.ground_effect_coefficient.to_string()),
        (
            "downwash",
            format!(
                "{{ strength_n: {}, width_slope: {}, width_offset_m: {} }}",
                downwash.strength, downwash.width_slope, downwash.width_offset
            ),
        ),
        (
            "collision",
            format!(
                "{{ radius_m: {}, height_m: {}, offset_m: {} }}",
                airframe.collision_radius, airframe.collision_height, airframe.collision_offset
            ),
        ),
        ("nominal_speed_km_per_h", digits(airframe.nominal_speed * 3.6)),
        ("effects", String::new()),
        ("  flapping_moment_n_s2_per_rad", digits(effects.flapping_moment)),
        ("  rate_damping_n_m_s_per_rad", three(effects.rate_damping)),
        ("  rotor_inertia_kg_m2", digits(effects.rotor_inertia)),
        ("  body_drag_n_s2_per_m2", digits(effects.body_drag)),
        ("  battery_sag", digits(effects.battery_sag)),
    ];
    for (key, value) in lines {
        // Writing into a string does not fail.
        let _ = writeln!(text, "{}", format!("{key}: {value}").trim_end());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_four_digits() {
        let shown = [0.0, 0.027, 1.93e-5, 21_702.6, 123_456.0, 0.0397, 1.0, -2.13e-11].map(digits);
        assert_eq!(shown, ["0", "0.027", "1.93e-5", "21703", "1.235e5", "0.0397", "1", "-2.13e-11"]);
    }

    #[test]
    fn comments_are_wrapped() {
        let mut text = String::new();
        comment(&mut text, &"word ".repeat(60));
        assert!(
            text.lines().count() == 3 && text.lines().all(|line| line.len() <= WIDTH && line.starts_with("# w"))
        );
    }
}
