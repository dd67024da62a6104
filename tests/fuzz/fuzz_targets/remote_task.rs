//! Any text as a task of robot and scanner gives a task that can be planned, or an error.
#![no_main]

use lasergym_remote::{PlanOptions, RemotePlan, RemoteTask, stops_of};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(task) = RemoteTask::from_toml(text, None) else { return };
    let Ok(stops) = stops_of(&task) else { return };
    // Planning time grows with the number of subtasks.
    if stops.len() <= 20 {
        let plan = RemotePlan::new(&task, &PlanOptions::default());
        assert_eq!(plan.map(|plan| plan.stops.len()).ok(), Some(stops.len()));
    }
});
