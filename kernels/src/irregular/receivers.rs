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

    /// Moves the receivers of a frame into the arena, untimed: that is work of the eye view. Only their pixels stay with `input`.
    ///
    /// # Panics
    /// If the receivers of `input` have been moved before.
    pub fn new(input: &mut ShadowInput, arena: &mut Arena) -> Receivers {
        assert_eq!(
            input.receivers.len(),
            input.receiver_pixel.len(),
            "the receivers of a frame are moved once"
        );
        let order = curve_order(input);
        let (places, triangles) =
            (core::mem::take(&mut input.receivers), core::mem::take(&mut input.receiver_triangle));
        let count = count_of(&places);
        let columns: Columns<Receiver> = Columns::overwritten(arena, count);
        for axis in [0, 1, 2] {
            let values = order.iter().map(|&i| places[i as usize][axis].to_bits());
            fill(arena, columns.column(field!(Receiver.position[axis])), values);
        }
        drop(places);
        let mut put = |field: Field<Receiver, u32>, value: &dyn Fn(usize) -> u32| {
            fill(arena, columns.column(field), order.iter().map(|&i| value(i as usize)));
        };
        put(field!(Receiver.triangle), &|receiver| triangles[receiver]);
        put(field!(Receiver.pixel), &|receiver| input.receiver_pixel.at(receiver));
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
    let (width, height) = (input.width, input.height);
    let count = input.receivers.len();
    let mut order = Vec::with_capacity(count);
    let side = width.max(height).next_power_of_two();
    if count as u64 == u64::from(width) * u64::from(height) {
        // Every pixel has one, of its own number.
        along_curve([width, height], [0, 0], side, [false; 2], &mut |x, y| order.push(y * width + x));
        return order;
    }
    let mut receivers = vec![NO_RECEIVER; width as usize * height as usize];
    for (receiver, pixel) in (0..).zip(input.receiver_pixel.iter()) {
        receivers[pixel as usize] = receiver;
    }
    along_curve([width, height], [0, 0], side, [false; 2], &mut |x, y| {
        let receiver = receivers[y as usize * width as usize + x as usize];
        if receiver != NO_RECEIVER {
            order.push(receiver);
        }
    });
    order
}

/// What stands for the receiver of a pixel that sees none.
const NO_RECEIVER: u32 = u32::MAX;

/// Visits the pixels of a picture of this size, as far as they lie in a square, along a Hilbert curve through it. `turned`: whether
/// the square's axes are exchanged, and whether both go the other way. `side`, that of the square, is a power of two.
pub fn along_curve(
    size: [u32; 2],
    corner: [u32; 2],
    side: u32,
    turned: [bool; 2],
    visit: &mut impl FnMut(u32, u32),
) {
    if corner[0] >= size[0] || corner[1] >= size[1] {
        return;
    }
    if side == 1 {
        visit(corner[0], corner[1]);
        return;
    }
    let [exchanged, reversed] = turned;
    for [right, upper] in [[false, false], [false, true], [true, true], [true, false]] {
        let [x, y] = if exchanged { [upper, right] } else { [right, upper] };
        let at = |corner: u32, far: bool| corner + u32::from(far != reversed) * (side / 2);
        let corner = [at(corner[0], x), at(corner[1], y)];
        // A lower quarter is turned once more, and the right one the other way around.
        let turned = [exchanged == upper, reversed != (right && !upper)];
        along_curve(size, corner, side / 2, turned, visit);
    }
}
