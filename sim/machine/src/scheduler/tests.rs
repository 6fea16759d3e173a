use super::*;
use crate::config::shipped;

#[test]
fn chunks_cover_all_tasks_once_and_shrink_to_one() {
    let config = shipped("larrabee-24");
    let mut spec = config.validate().expect("sound");
    spec.chunk_tasks_max = 4;
    let mut counter = TaskCounter::new(chunk_lengths(1000, 96, &spec));
    let (mut next, mut last) = (0, u32::MAX);
    loop {
        let chunk = counter.take();
        if chunk.is_empty() {
            break;
        }
        assert_eq!(chunk.start, next);
        assert!(chunk.len() as u32 <= last.min(4));
        (next, last) = (chunk.end, chunk.len() as u32);
    }
    assert_eq!((next, last), (1000, 1));
}
