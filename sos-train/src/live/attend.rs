//! What a run does between two steps for whoever looks.

use super::{Live, Wish};
use crate::prepare::Prepared;
use crate::render::preview;
use crate::report::jpeg_bytes;
use crate::train::{Trainer, schedule};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Time between two looks at a page's wishes while a run waits.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Width of a panel in pixels: of four, drawn while training waits.
const PANEL: u32 = 176;

/// Draws what somebody waits for, and waits as long as the run is paused. Returns how long that was,
/// and what is wished then.
pub(crate) fn attend(live: &Live, trainer: &Trainer, data: &Prepared) -> (Duration, Wish) {
    let step = trainer.step_number();
    live.at_step(step, step > schedule::carve_step(trainer.config()));
    draw(live, trainer, data);
    let begun = Instant::now();
    let mut waited = Duration::ZERO;
    while live.wish() == Wish::Pause {
        sleep(LOOK_EVERY);
        draw(live, trainer, data);
        waited = begun.elapsed();
    }
    (waited, live.wish())
}

fn draw(live: &Live, trainer: &Trainer, data: &Prepared) {
    let Some(index) = live.next_picture() else {
        return;
    };
    let begun = Instant::now();
    let picture = preview::panels(&trainer.freeze(), data, index, PANEL);
    let jpeg = jpeg_bytes(&picture);
    live.show(index, trainer.step_number(), jpeg, begun.elapsed());
}
