//! A trace as a program: forwards for its values, backwards for the derivatives of its outputs, many lanes at a time.

use kestrel_core::real::Real;
use pulp::{Simd, WithSimd};

use super::traced::{Binary, Operation, Unary};
use crate::simd::Arch;

/// Lanes that a program works on at a time.
pub const LANES: usize = 64;

/// One value per lane.
pub(super) type Lane = [f32; LANES];

/// A computation, its inputs, and how the derivatives of its outputs come back to them.
///
/// Every value has a slot: the inputs, then the constants, then the results of the instructions. An adjoint, the
/// derivative of a weighted sum of the outputs, has the slot of its value.
#[derive(Clone, Debug)]
pub(super) struct Program {
    /// Indices of the inputs that it reads, by slot.
    pub(super) inputs: Vec<usize>,
    constants: Vec<f32>,
    instructions: Vec<Instruction>,
    /// What adds to adjoints, last instruction first.
    pulls: Vec<Pull>,
    /// Slots whose adjoints begin at zero.
    cleared: Vec<u32>,
    slots: usize,
}

/// What computes a slot from slots before.
#[derive(Clone, Copy, Debug)]
enum Instruction {
    Unary(Unary, u32),
    Binary(Binary, [u32; 2]),
    Select {
        less: [u32; 2],
        then: u32,
        otherwise: u32,
    },
    /// The sum of both parts, or the first minus the second.
    Sum {
        parts: [Part; 2],
        is_difference: bool,
    },
}

#[derive(Clone, Copy, Debug)]
enum Part {
    Value(u32),
    /// A product that is used nowhere else, and has no slot.
    Product([u32; 2]),
}

/// Adds the adjoint of a result, times the derivative by an operand, to the operand's adjoint.
#[derive(Clone, Copy, Debug)]
struct Pull {
    from: u32,
    to: u32,
    /// Nothing was added before.
    is_first: bool,
    factor: Factor,
}

/// Derivative of a result by an operand; numbers are slots of values.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Factor {
    One,
    MinusOne,
    /// The value.
    Value(u32),
    MinusValue(u32),
    /// One over the value.
    Inverse(u32),
    /// Minus one value over another: of a quotient by its divisor.
    MinusRatio([u32; 2]),
    /// Half the inverse of a root; zero at zero, where there is none.
    Root(u32),
    Sign(u32),
    Angular(Angular),
    /// One where the first is less than the second.
    WhereLess([u32; 2]),
    WhereNotLess([u32; 2]),
}

/// Derivatives of functions of angles.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Angular {
    Cosine(u32),
    MinusSine(u32),
    /// One over √(1 − x²).
    ArcSine(u32),
    /// Of the angle of a point (ordinate, abscissa) by its ordinate.
    ByOrdinate([u32; 2]),
    ByAbscissa([u32; 2]),
}

/// The operands by which a result has a derivative.
type Derivatives = [Option<(u32, Factor)>; 4];

/// Room for the values and adjoints of a program.
#[derive(Clone, Debug)]
pub struct Workspace {
    pub(super) values: Vec<Lane>,
    pub(super) adjoints: Vec<Lane>,
}

/// What is wanted of a trace.
pub(super) struct Wanted<'a> {
    /// Places whose values and derivatives are asked for.
    pub(super) outputs: &'a [u32],
    /// Whether derivatives go to the input with an index.
    pub(super) is_active: &'a dyn Fn(usize) -> bool,
}

impl Program {
    /// What the outputs need of a trace, and the slots of the outputs.
    pub(super) fn new(trace: &[Operation], wanted: &Wanted<'_>) -> (Self, Vec<u32>) {
        let uses = uses(trace, wanted.outputs);
        let is_merged = |place: u32| {
            uses[place as usize] == Uses::OnceInSum
                && matches!(trace[place as usize], Operation::Binary(Binary::Product, _))
        };
        let (mut inputs, mut constants, mut rest) = (Vec::new(), Vec::new(), Vec::new());
        for (place, operation) in trace.iter().enumerate().filter(|(place, _)| uses[*place] != Uses::None) {
            match operation {
                Operation::Input(index) => inputs.push((place, *index as usize)),
                Operation::Constant(bits) => constants.push((place, f32::from_bits(*bits))),
                Operation::Binary(..) if is_merged(place as u32) => {}
                Operation::Unary(..)
                | Operation::Binary(..)
                | Operation::Sum { .. }
                | Operation::Select { .. } => rest.push(place),
            }
        }
        let mut slot_of = vec![0; trace.len()];
        let places = inputs.iter().map(|(place, _)| *place).chain(constants.iter().map(|(place, _)| *place));
        for (slot, place) in places.chain(rest.iter().copied()).enumerate() {
            slot_of[place] = slot as u32;
        }
        let slot = |place: u32| slot_of[place as usize];
        let part = |place: u32| match trace[place as usize] {
            Operation::Binary(Binary::Product, pair) if is_merged(place) => Part::Product(pair.map(slot)),
            Operation::Input(_)
            | Operation::Constant(_)
            | Operation::Unary(..)
            | Operation::Binary(..)
            | Operation::Sum { .. }
            | Operation::Select { .. } => Part::Value(slot(place)),
        };
        let instructions: Vec<Instruction> =
            rest.iter().filter_map(|place| Instruction::new(&trace[*place], slot, part)).collect();
        let outputs: Vec<u32> = wanted.outputs.iter().map(|place| slot(*place)).collect();
        let first = inputs.len() + constants.len();
        let mut program = Self {
            inputs: inputs.into_iter().map(|(_, index)| index).collect(),
            constants: constants.into_iter().map(|(_, value)| value).collect(),
            slots: first + instructions.len(),
            instructions,
            pulls: Vec::new(),
            cleared: Vec::new(),
        };
        program.reverse(&outputs, wanted.is_active);
        (program, outputs)
    }

    fn first_result(&self) -> usize {
        self.inputs.len() + self.constants.len()
    }

    /// Which slots have a derivative by an active input.
    fn active(&self, is_active: &dyn Fn(usize) -> bool) -> Vec<bool> {
        let mut active = vec![false; self.slots];
        for (slot, index) in self.inputs.iter().enumerate() {
            active[slot] = is_active(*index);
        }
        for (index, instruction) in self.instructions.iter().enumerate() {
            let any = instruction.derivatives(0).iter().flatten().any(|(operand, _)| active[*operand as usize]);
            active[self.first_result() + index] = any;
        }
        active
    }

    /// Lays down the way back from the outputs to the active inputs.
    fn reverse(&mut self, outputs: &[u32], is_active: &dyn Fn(usize) -> bool) {
        let active = self.active(is_active);
        // Outputs are seeded, and inputs read, whether anything is added to them or not.
        let mut written = vec![false; self.slots];
        let ends = outputs.iter().copied().chain(0..self.inputs.len() as u32);
        for slot in ends {
            if !core::mem::replace(&mut written[slot as usize], true) {
                self.cleared.push(slot);
            }
        }
        let lone = self.lone_operands(&written);
        // An operand of nothing but a sum has the adjoint of the sum.
        let mut adjoint_of: Vec<u32> = (0..self.slots as u32).collect();
        for index in (0..self.instructions.len()).rev() {
            let result = (self.first_result() + index) as u32;
            if !written[result as usize] || !active[result as usize] {
                continue;
            }
            for (to, factor) in self.instructions[index].derivatives(result).into_iter().flatten() {
                if !active[to as usize] {
                    continue;
                }
                let is_first = !core::mem::replace(&mut written[to as usize], true);
                let from = adjoint_of[result as usize];
                if factor == Factor::One && lone[to as usize] {
                    adjoint_of[to as usize] = from;
                } else {
                    self.pulls.push(Pull { from, to, is_first, factor });
                }
            }
        }
    }

    /// Slots that a single instruction reads, once, and nobody else; `ends` are read from outside.
    fn lone_operands(&self, ends: &[bool]) -> Vec<bool> {
        let mut reads = vec![0_u32; self.slots];
        let derivatives = self.instructions.iter().flat_map(|instruction| instruction.derivatives(0));
        derivatives.flatten().for_each(|(operand, _)| reads[operand as usize] += 1);
        reads.iter().zip(ends).map(|(reads, is_end)| *reads == 1 && !is_end).collect()
    }

    /// Room for its values.
    pub(super) fn workspace(&self) -> Workspace {
        let mut workspace =
            Workspace { values: vec![[0.0; LANES]; self.slots], adjoints: vec![[0.0; LANES]; self.slots] };
        let constants = &mut workspace.values[self.inputs.len()..];
        constants.iter_mut().zip(&self.constants).for_each(|(value, constant)| value.fill(*constant));
        workspace
    }

    /// Computes all values from those of the inputs, which the caller has written to the first slots.
    pub(super) fn run(&self, workspace: &mut Workspace) {
        Arch::new().dispatch(Run { program: self, workspace });
    }

    /// Sets the adjoints of all outputs and inputs to zero.
    pub(super) fn clear(&self, workspace: &mut Workspace) {
        for slot in &self.cleared {
            workspace.adjoints[*slot as usize].fill(0.0);
        }
    }

    /// Carries the adjoints of the outputs, which the caller has added to since [`Self::clear`], to the inputs.
    pub(super) fn pull_back(&self, workspace: &mut Workspace) {
        Arch::new().dispatch(PullBack { program: self, workspace });
    }

    /// Number of operations forwards, and of additions backwards.
    pub(super) fn len(&self) -> (usize, usize) {
        (self.instructions.len(), self.pulls.len())
    }
}

/// What some places of a trace are computed from, themselves included.
pub(super) fn needed(trace: &[Operation], outputs: &[u32]) -> Vec<bool> {
    let mut needed = vec![false; trace.len()];
    for place in outputs {
        needed[*place as usize] = true;
    }
    for place in (0..trace.len()).rev() {
        if needed[place] {
            operands(&trace[place]).into_iter().flatten().for_each(|operand| needed[operand as usize] = true);
        }
    }
    needed
}

/// Inputs by which some places of a trace have a derivative.
pub(super) fn sources(trace: &[Operation], outputs: &[u32]) -> Vec<usize> {
    let mut reached = vec![false; trace.len()];
    for place in outputs {
        reached[*place as usize] = true;
    }
    let mut inputs = Vec::new();
    for place in (0..trace.len()).rev() {
        if !reached[place] {
            continue;
        }
        if let Operation::Input(index) = trace[place] {
            inputs.push(index as usize);
        }
        let instruction = Instruction::new(&trace[place], |place| place, Part::Value);
        let derivatives = instruction.map_or([None; 4], |instruction| instruction.derivatives(0));
        derivatives.into_iter().flatten().for_each(|(to, _)| reached[to as usize] = true);
    }
    inputs
}

/// Who needs an operation of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Uses {
    None,
    /// One sum or difference, once.
    OnceInSum,
    More,
}

fn uses(trace: &[Operation], outputs: &[u32]) -> Vec<Uses> {
    let mut uses = vec![Uses::None; trace.len()];
    for place in outputs {
        uses[*place as usize] = Uses::More;
    }
    for place in (0..trace.len()).rev() {
        if uses[place] == Uses::None {
            continue;
        }
        let is_sum = matches!(trace[place], Operation::Sum { .. });
        for operand in operands(&trace[place]).into_iter().flatten() {
            let found = &mut uses[operand as usize];
            *found = if *found == Uses::None && is_sum { Uses::OnceInSum } else { Uses::More };
        }
    }
    uses
}

fn operands(operation: &Operation) -> [Option<u32>; 4] {
    match *operation {
        Operation::Input(_) | Operation::Constant(_) => [None; 4],
        Operation::Unary(_, one) => [Some(one), None, None, None],
        Operation::Binary(_, [one, other]) | Operation::Sum { of: [one, other], .. } => {
            [Some(one), Some(other), None, None]
        }
        Operation::Select { less: [low, high], then, otherwise } => {
            [Some(low), Some(high), Some(then), Some(otherwise)]
        }
    }
}

impl Instruction {
    /// An operation with slots for places; none for what is not computed.
    fn new(operation: &Operation, slot: impl Fn(u32) -> u32, part: impl Fn(u32) -> Part) -> Option<Self> {
        match *operation {
            Operation::Input(_) | Operation::Constant(_) => None,
            Operation::Unary(function, one) => Some(Self::Unary(function, slot(one))),
            Operation::Binary(function, pair) => Some(Self::Binary(function, pair.map(slot))),
            Operation::Sum { of, is_difference } => Some(Self::Sum { parts: of.map(part), is_difference }),
            Operation::Select { less, then, otherwise } => {
                Some(Self::Select { less: less.map(&slot), then: slot(then), otherwise: slot(otherwise) })
            }
        }
    }

    /// The operands by which it has a derivative, and the derivative; `result` is its own slot.
    fn derivatives(&self, result: u32) -> Derivatives {
        match *self {
            Self::Unary(function, one) => {
                [unary_factor(function, one, result).map(|factor| (one, factor)), None, None, None]
            }
            Self::Binary(function, [one, other]) => {
                let (by_one, by_other) = match function {
                    Binary::Product => (Factor::Value(other), Factor::Value(one)),
                    Binary::Quotient => (Factor::Inverse(other), Factor::MinusRatio([result, other])),
                    Binary::ArcTangent => {
                        let by_ordinate = Factor::Angular(Angular::ByOrdinate([one, other]));
                        (by_ordinate, Factor::Angular(Angular::ByAbscissa([one, other])))
                    }
                };
                [Some((one, by_one)), Some((other, by_other)), None, None]
            }
            Self::Select { less, then, otherwise } => {
                [Some((then, Factor::WhereLess(less))), Some((otherwise, Factor::WhereNotLess(less))), None, None]
            }
            Self::Sum { parts: [first, second], is_difference } => {
                let ([a, b], [c, d]) = (first.derivatives(false), second.derivatives(is_difference));
                [a, b, c, d]
            }
        }
    }
}

impl Part {
    fn derivatives(self, is_subtracted: bool) -> [Option<(u32, Factor)>; 2] {
        let signed = |value: u32| if is_subtracted { Factor::MinusValue(value) } else { Factor::Value(value) };
        match self {
            Self::Value(slot) => [Some((slot, if is_subtracted { Factor::MinusOne } else { Factor::One })), None],
            Self::Product([one, other]) => [Some((one, signed(other))), Some((other, signed(one)))],
        }
    }
}

fn unary_factor(function: Unary, operand: u32, result: u32) -> Option<Factor> {
    match function {
        Unary::Negative => Some(Factor::MinusOne),
        Unary::Root => Some(Factor::Root(result)),
        Unary::Magnitude => Some(Factor::Sign(operand)),
        Unary::Sine => Some(Factor::Angular(Angular::Cosine(operand))),
        Unary::Cosine => Some(Factor::Angular(Angular::MinusSine(operand))),
        Unary::ArcSine => Some(Factor::Angular(Angular::ArcSine(operand))),
        Unary::Exponential => Some(Factor::Value(result)),
        Unary::Logarithm => Some(Factor::Inverse(operand)),
        Unary::Floor => None,
    }
}

struct Run<'a> {
    program: &'a Program,
    workspace: &'a mut Workspace,
}

impl WithSimd for Run<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let first = self.program.first_result();
        for (index, instruction) in self.program.instructions.iter().enumerate() {
            let (before, from) = self.workspace.values.split_at_mut(first + index);
            let (result, value) = (&mut from[0], |slot: u32| &before[slot as usize]);
            match *instruction {
                Instruction::Unary(function, one) => apply(result, function, value(one)),
                Instruction::Binary(function, [one, other]) => {
                    combine(result, function, value(one), value(other));
                }
                Instruction::Sum { parts, is_difference } => {
                    if is_difference {
                        add_up(result, parts, value, |one, other| one - other);
                    } else {
                        add_up(result, parts, value, |one, other| one + other);
                    }
                }
                Instruction::Select { less: [low, high], then, otherwise } => {
                    let (low, high, then, otherwise) = (value(low), value(high), value(then), value(otherwise));
                    for lane in 0..LANES {
                        result[lane] = low[lane].where_less(high[lane], then[lane], otherwise[lane]);
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn apply(result: &mut Lane, function: Unary, one: &Lane) {
    // Matched out here, so that the loop over lanes has no branch and vectorises.
    macro_rules! each {
        ($($function:ident),*) => {
            match function {
                $(Unary::$function => for lane in 0..LANES {
                    result[lane] = Unary::$function.of(one[lane]);
                }),*
            }
        };
    }
    each!(Negative, Root, Magnitude, Sine, Cosine, ArcSine, Exponential, Logarithm, Floor);
}

#[inline(always)]
fn combine(result: &mut Lane, function: Binary, one: &Lane, other: &Lane) {
    macro_rules! each {
        ($($function:ident),*) => {
            match function {
                $(Binary::$function => for lane in 0..LANES {
                    result[lane] = Binary::$function.of(one[lane], other[lane]);
                }),*
            }
        };
    }
    each!(Product, Quotient, ArcTangent);
}

#[inline(always)]
fn add_up<'a>(
    result: &mut Lane,
    parts: [Part; 2],
    value: impl Fn(u32) -> &'a Lane,
    sum: impl Fn(f32, f32) -> f32,
) {
    match parts {
        [Part::Value(a), Part::Value(b)] => {
            let (a, b) = (value(a), value(b));
            (0..LANES).for_each(|lane| result[lane] = sum(a[lane], b[lane]));
        }
        [Part::Product([a, b]), Part::Value(c)] => {
            let (a, b, c) = (value(a), value(b), value(c));
            (0..LANES).for_each(|lane| result[lane] = sum(a[lane] * b[lane], c[lane]));
        }
        [Part::Value(a), Part::Product([b, c])] => {
            let (a, b, c) = (value(a), value(b), value(c));
            (0..LANES).for_each(|lane| result[lane] = sum(a[lane], b[lane] * c[lane]));
        }
        [Part::Product([a, b]), Part::Product([c, d])] => {
            let (a, b, c, d) = (value(a), value(b), value(c), value(d));
            (0..LANES).for_each(|lane| result[lane] = sum(a[lane] * b[lane], c[lane] * d[lane]));
        }
    }
}

struct PullBack<'a> {
    program: &'a Program,
    workspace: &'a mut Workspace,
}

impl WithSimd for PullBack<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Workspace { values, adjoints } = self.workspace;
        for Pull { from, to, is_first, factor } in &self.program.pulls {
            // An operand stands before its result.
            let (before, rest) = adjoints.split_at_mut(*from as usize);
            let (from, to) = (&rest[0], &mut before[*to as usize]);
            if *is_first {
                pull(values, *factor, from, to, |to, part| *to = part);
            } else {
                pull(values, *factor, from, to, |to, part| *to += part);
            }
        }
    }
}

/// Writes what a derivative makes of an adjoint.
#[inline(always)]
fn pull(values: &[Lane], factor: Factor, from: &Lane, to: &mut Lane, write: impl Fn(&mut f32, f32)) {
    let value = |slot: u32| &values[slot as usize];
    match factor {
        Factor::One => each(from, to, write, |_, adjoint| adjoint),
        Factor::MinusOne => each(from, to, write, |_, adjoint| -adjoint),
        Factor::Value(factor) => {
            let factor = value(factor);
            each(from, to, write, |lane, adjoint| adjoint * factor[lane]);
        }
        Factor::MinusValue(factor) => {
            let factor = value(factor);
            each(from, to, write, |lane, adjoint| -adjoint * factor[lane]);
        }
        Factor::Inverse(divisor) => {
            let divisor = value(divisor);
            each(from, to, write, |lane, adjoint| finite(adjoint, adjoint / divisor[lane]));
        }
        Factor::MinusRatio([quotient, divisor]) => {
            let (quotient, divisor) = (value(quotient), value(divisor));
            each(from, to, write, |lane, adjoint| finite(adjoint, -adjoint * quotient[lane] / divisor[lane]));
        }
        Factor::Root(root) => {
            let root = value(root);
            each(from, to, write, |lane, adjoint| if root[lane] > 0.0 { 0.5 * adjoint / root[lane] } else { 0.0 });
        }
        Factor::Sign(signed) => {
            let signed = value(signed);
            each(from, to, write, |lane, adjoint| if signed[lane] < 0.0 { -adjoint } else { adjoint });
        }
        Factor::Angular(factor) => pull_angle(values, factor, from, to, write),
        Factor::WhereLess([low, high]) => {
            let (low, high) = (value(low), value(high));
            each(from, to, write, |lane, adjoint| if low[lane] < high[lane] { adjoint } else { 0.0 });
        }
        Factor::WhereNotLess([low, high]) => {
            let (low, high) = (value(low), value(high));
            each(from, to, write, |lane, adjoint| if low[lane] < high[lane] { 0.0 } else { adjoint });
        }
    }
}

#[inline(always)]
fn pull_angle(values: &[Lane], factor: Angular, from: &Lane, to: &mut Lane, write: impl Fn(&mut f32, f32)) {
    let value = |slot: u32| &values[slot as usize];
    match factor {
        Angular::Cosine(angle) => {
            let angle = value(angle);
            each(from, to, write, |lane, adjoint| adjoint * Real::cos(angle[lane]));
        }
        Angular::MinusSine(angle) => {
            let angle = value(angle);
            each(from, to, write, |lane, adjoint| -adjoint * Real::sin(angle[lane]));
        }
        Angular::ArcSine(sine) => {
            let sine = value(sine);
            each(from, to, write, |lane, adjoint| {
                adjoint / Real::sqrt((1.0 - sine[lane] * sine[lane]).max(f32::EPSILON))
            });
        }
        Angular::ByOrdinate([ordinate, abscissa]) => {
            let (y, x) = (value(ordinate), value(abscissa));
            each(from, to, write, |lane, adjoint| {
                finite(adjoint, adjoint * x[lane] / (x[lane] * x[lane] + y[lane] * y[lane]))
            });
        }
        Angular::ByAbscissa([ordinate, abscissa]) => {
            let (y, x) = (value(ordinate), value(abscissa));
            each(from, to, write, |lane, adjoint| {
                finite(adjoint, -adjoint * y[lane] / (x[lane] * x[lane] + y[lane] * y[lane]))
            });
        }
    }
}

/// Nothing is asked for where an adjoint is zero: there a derivative may be infinite.
#[inline(always)]
fn finite(adjoint: f32, part: f32) -> f32 {
    if adjoint == 0.0 { 0.0 } else { part }
}

#[inline(always)]
fn each(from: &Lane, to: &mut Lane, write: impl Fn(&mut f32, f32), part: impl Fn(usize, f32) -> f32) {
    for lane in 0..LANES {
        write(&mut to[lane], part(lane, from[lane]));
    }
}
