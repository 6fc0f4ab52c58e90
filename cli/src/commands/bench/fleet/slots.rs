//! Slots of a light worker. The next range gets the slot that has been free for the longest time.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use tokio::sync::{Semaphore, SemaphorePermit};

/// All slots of a worker.
pub struct Slots {
    room: Semaphore,
    /// For each free slot, the time since which it is free.
    free: Mutex<VecDeque<Instant>>,
}

/// Occupied slot.
pub struct Slot<'a> {
    slots: &'a Slots,
    /// Time since which the slot had been free.
    pub free_since: Instant,
    _permit: SemaphorePermit<'a>,
}

impl Slots {
    /// Creates slots that are free from now on.
    pub fn new(count: u32) -> Self {
        let free = std::iter::repeat_n(Instant::now(), count as usize).collect();
        Self { room: Semaphore::new(count as usize), free: Mutex::new(free) }
    }

    /// Waits for a free slot; requests are served in order.
    pub async fn take(&self) -> Slot<'_> {
        let permit = self.room.acquire().await.expect("the semaphore is never closed");
        let free_since = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
        Slot { slots: self, free_since: free_since.unwrap_or_else(Instant::now), _permit: permit }
    }
}

impl Drop for Slot<'_> {
    fn drop(&mut self) {
        // Runs before the permit is released: fields are dropped after this.
        self.slots.free.lock().unwrap_or_else(PoisonError::into_inner).push_back(Instant::now());
    }
}
