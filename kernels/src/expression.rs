//! Integer arithmetic of kernels, written as expressions: addresses, counts and numbers of things.
//!
//! One operator a level, parentheses around every operand that is an expression itself: the uops stand in the order in which
//! one reads, operands before operators, left before right.

/// An expression of scalar registers: `scalar!(v, (samples + 15) >> 4)`.
///
/// Each operator is one uop: `+` `s_add`, `-` `s_sub`, `*` `s_mul`, `&` `s_and`, `<<` `s_shl`, `>>` `s_shr` (unsigned).
/// Literals, and host constants in braces, are immediates, which are no uops.
macro_rules! scalar {
    (@ $v:ident, $operation:ident, $a:tt, $b:tt) => {{
        let a = scalar!($v, $a);
        let b = scalar!($v, $b);
        $v.$operation(a, b)
    }};
    ($v:ident, $a:tt + $b:tt) => { scalar!(@ $v, s_add, $a, $b) };
    ($v:ident, $a:tt - $b:tt) => { scalar!(@ $v, s_sub, $a, $b) };
    ($v:ident, $a:tt * $b:tt) => { scalar!(@ $v, s_mul, $a, $b) };
    ($v:ident, $a:tt & $b:tt) => { scalar!(@ $v, s_and, $a, $b) };
    ($v:ident, $a:tt << $b:tt) => { scalar!(@ $v, s_shl, $a, $b) };
    ($v:ident, $a:tt >> $b:tt) => { scalar!(@ $v, s_shr, $a, $b) };
    ($v:ident, ($($inner:tt)+)) => { scalar!($v, $($inner)+) };
    ($v:ident, {$constant:expr}) => { $v.s_imm($constant) };
    ($v:ident, $literal:literal) => { $v.s_imm($literal) };
    ($v:ident, $value:ident) => { $value };
}
pub(crate) use scalar;

/// An expression of vectors of integers, lane by lane: `int!(v, (cell << two) | slice)`.
///
/// Each operator is one uop: `+` `viadd`, `-` `visub`, `*` `vimul`, `&` `vand`, `|` `vor`, `<<` `vsll`, `>>` `vsrl`
/// (unsigned). Operands are values: a constant is a load, so that a kernel names it where it is loaded once.
macro_rules! int {
    (@ $v:ident, $operation:ident, $a:tt, $b:tt) => {{
        let a = int!($v, $a);
        let b = int!($v, $b);
        $v.$operation(a, b)
    }};
    ($v:ident, $a:tt + $b:tt) => { int!(@ $v, viadd, $a, $b) };
    ($v:ident, $a:tt - $b:tt) => { int!(@ $v, visub, $a, $b) };
    ($v:ident, $a:tt * $b:tt) => { int!(@ $v, vimul, $a, $b) };
    ($v:ident, $a:tt & $b:tt) => { int!(@ $v, vand, $a, $b) };
    ($v:ident, $a:tt | $b:tt) => { int!(@ $v, vor, $a, $b) };
    ($v:ident, $a:tt << $b:tt) => { int!(@ $v, vsll, $a, $b) };
    ($v:ident, $a:tt >> $b:tt) => { int!(@ $v, vsrl, $a, $b) };
    ($v:ident, ($($inner:tt)+)) => { int!($v, $($inner)+) };
    ($v:ident, $value:ident) => { $value };
}
pub(crate) use int;

/// An array of what an expression is for each of some values: `each!(axis in [0, 1, 2] => load(v, axis))`.
///
/// The expression stands there as often as there are values. `map` would call a closure, and what is called is not
/// compiled for the host's vector instructions, see [`lrbsim_isa::kernel`].
macro_rules! each {
    ($name:ident in [$($value:expr),+] => $expression:expr) => {
        [$({
            let $name = $value;
            $expression
        }),+]
    };
}
pub(crate) use each;
