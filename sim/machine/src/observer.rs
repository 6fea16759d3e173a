//! Who watches steps, tasks and barriers pass, such as a timeline.

use crate::Cycle;
use std::ops::Range;

/// Hears of steps, tasks and barriers as a [`Chip`](crate::Chip) times them. Nothing that it does can change a result.
///
/// A chip is compiled for its observer: one that does nothing, as `()`, leaves no code behind.
pub trait Observer {
    /// Step `name` of `tasks` tasks begins at `start`.
    fn step(&mut self, name: &str, tasks: u32, start: Cycle);

    /// Hardware thread `thread` of core `core` has done what it took before and asks for tasks at `asked`; it gets `tasks`,
    /// which are none when the step has no more, and may begin them at `from`.
    fn tasks(&mut self, core: usize, thread: u8, tasks: Range<u32>, asked: Cycle, from: Cycle);

    /// The last thread came to the barrier at `arrival`, and the step ends at `end`.
    fn barrier(&mut self, arrival: Cycle, end: Cycle);
}

/// Nobody watches.
impl Observer for () {
    #[inline(always)]
    fn step(&mut self, _: &str, _: u32, _: Cycle) {}

    #[inline(always)]
    fn tasks(&mut self, _: usize, _: u8, _: Range<u32>, _: Cycle, _: Cycle) {}

    #[inline(always)]
    fn barrier(&mut self, _: Cycle, _: Cycle) {}
}
