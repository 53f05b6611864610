//! The formulas of the fixed-point anchor, written again from its documentation: in wider integers, by divisions instead
//! of shifts and by search instead of logarithms.

/// 2⁻²⁴.
const ONE: i128 = 1 << 24;

/// `floor(2^(steps / 8) · 2^(24 + whole octaves))`, from the exactly rounded eighth.
pub(crate) fn importance(code: u8) -> i128 {
    if code == 0 {
        return 0;
    }
    let steps = i128::from(code) - 1;
    let eighth = (libm::exp2((steps % 8) as f64 / 8.0) * 16_777_216.0).round() as i128;
    (eighth * 2_i128.pow((steps / 8) as u32)).div_euclid(65_536)
}

pub(crate) fn proximal_share(code: u8, rate: u32) -> i128 {
    if code == 0 {
        return 0;
    }
    let steps = i128::from(code) - 1;
    let eighth = (libm::exp2((steps % 8) as f64 / 8.0) * 16_777_216.0).round() as i128;
    // In 2⁻²⁴: 2⁻²⁴ of the rate, 2⁻²⁴ of the eighth and 2⁻¹⁶ of the least importance.
    let odds = (eighth * i128::from(rate) * 2_i128.pow((steps / 8) as u32)).div_euclid(2_i128.pow(40));
    let rest = (2 * ONE * ONE + (ONE + odds)).div_euclid(2 * (ONE + odds));
    (ONE - rest).min(ONE - 1)
}

fn turn(call: u32, index: usize, offset: i128) -> i128 {
    let angle = i128::from(call) * 0x9E37_79B9 + index as i128 * 0x91E1_0DA5 + offset;
    angle.rem_euclid(1 << 32).div_euclid(256)
}

fn moved(from: i16, target: i16, share: i128, dither: i128) -> i16 {
    let step = ((i128::from(target) - i128::from(from)) * share + dither).div_euclid(ONE);
    i16::try_from(i128::from(from) + step).expect("a move ends between its ends")
}

pub(crate) fn proximal_step(parameters: &mut [i16], center: &[i16], codes: &[u8], rate: u32, call: u32) {
    for (index, parameter) in parameters.iter_mut().enumerate() {
        *parameter = moved(*parameter, center[index], proximal_share(codes[index], rate), turn(call, index, 0));
    }
}

pub(crate) fn consolidate(
    (center, codes): (&mut [i16], &mut [u8]),
    parameters: &[i16],
    curvature: &[u8],
    decay: u32,
    task: u32,
) {
    for index in 0..parameters.len() {
        let taken = importance(curvature[index]);
        let total = (importance(codes[index]) * i128::from(decay).min(ONE)).div_euclid(ONE) + taken;
        let gain = if total == 0 { 0 } else { (taken * ONE).div_euclid(total) };
        center[index] = moved(center[index], parameters[index], gain, turn(task, index, 0));
        codes[index] = code(total, turn(task, index, 1 << 31));
    }
}

fn code(total: i128, dither: i128) -> u8 {
    let below = (0..=255).rev().find(|&code| importance(code) <= total).expect("a code of zero is never above");
    if below == 255 {
        return below;
    }
    let (lower, upper) = (importance(below), importance(below + 1));
    below + u8::from((total - lower) * ONE > dither * (upper - lower))
}
