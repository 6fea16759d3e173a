//! Receivers: what the eye sees, and the order in which it leaves them.

use lrbsim_isa::Arena;
use lrbsim_workloads::ShadowInput;

use crate::columns::Columns;
use crate::field;
use crate::record::Field;
use crate::scene::{Viewpoint, count_of, fill};

/// A point visible from the eye, one a covered pixel.
#[repr(C)]
pub struct Receiver {
    /// Where the receiver lies, light-centred.
    pub position: [f32; 3],
    /// Number of the triangle that it lies on, which does not shadow it.
    pub triangle: u32,
    /// The pixel that sees it, row-major.
    pub pixel: u32,
}

/// The receivers of a frame, along a Hilbert curve through the picture.
#[derive(Clone, Copy)]
pub struct Receivers {
    /// Where the receivers are seen from: kernels look at their places from there.
    pub viewpoint: Viewpoint,
    /// Receivers, field by field.
    pub columns: Columns<Receiver>,
    /// Number of receivers.
    pub count: u32,
}

impl Receivers {
    /// Receivers of a task: neighbors in the picture, along the curve.
    pub const TASK: u32 = 1024;

    /// Copies the receivers of a frame into the arena, untimed: that is work of the eye view.
    pub fn new(input: &ShadowInput, arena: &mut Arena) -> Receivers {
        let order = curve_order(input);
        let count = count_of(&input.receivers);
        let columns: Columns<Receiver> = Columns::overwritten(arena, count);
        for axis in 0..3 {
            let values = order.iter().map(|&i| input.receivers[i as usize][axis].to_bits());
            fill(arena, columns.column(field!(Receiver.position[axis])), values);
        }
        let mut put = |field: Field<Receiver, u32>, values: &[u32]| {
            fill(arena, columns.column(field), order.iter().map(|&i| values[i as usize]));
        };
        put(field!(Receiver.triangle), &input.receiver_triangle);
        put(field!(Receiver.pixel), &input.receiver_pixel);
        Receivers { viewpoint: Viewpoint::default(), columns, count }
    }

    /// These receivers as they are seen from `viewpoint`.
    pub fn seen_from(self, viewpoint: Viewpoint) -> Receivers {
        Receivers { viewpoint, ..self }
    }

    /// Tasks of a step that goes through the receivers.
    pub fn tasks(&self) -> u32 {
        self.count.div_ceil(Receivers::TASK)
    }
}

/// Order in which the eye view leaves its receivers: along a Hilbert curve through the picture, so that receivers that
/// follow one another share cells.
fn curve_order(input: &ShadowInput) -> Vec<u32> {
    let side = input.width.max(input.height).next_power_of_two();
    let mut order: Vec<u32> = (0..input.receivers.len() as u32).collect();
    order.sort_by_cached_key(|&i| {
        let pixel = input.receiver_pixel[i as usize];
        hilbert(side, pixel % input.width, pixel / input.width)
    });
    order
}

/// Place of a pixel on the Hilbert curve through a square; `side` is a power of two.
pub fn hilbert(side: u32, mut x: u32, mut y: u32) -> u64 {
    let mut place = 0;
    let mut half = side / 2;
    while half > 0 {
        let (right, upper) = (u32::from(x & half > 0), u32::from(y & half > 0));
        place = place << 2 | u64::from((3 * right) ^ upper);
        if upper == 0 {
            if right == 1 {
                (x, y) = (side - 1 - x, side - 1 - y);
            }
            (x, y) = (y, x);
        }
        half /= 2;
    }
    place
}
