//! Milliseconds that each view of a file takes natively, on one thread, in coding order, as a JSON list: the least of three rounds. What
//! the module does in the browser, for comparison.

use std::time::Instant;
use tsuya::Limits;
use tsuya::container::Poll;
use tsuya::decoder::{IncrementalDecoder, PhotographCoding, ViewStatus};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: native FILE")?;
    let bytes = std::fs::read(path)?;
    let mut best: Vec<f64> = Vec::new();
    for _ in 0..3 {
        let mut file = IncrementalDecoder::new(Some(bytes.len() as u64), true, Limits::default());
        file.feed(0, &bytes)?;
        let Poll::Ready(header) = file.header()? else { return Err("the file is cut".into()) };
        file.mesh()?;
        let order: Vec<usize> = match &header.photographs {
            PhotographCoding::Predictive(planes) => {
                planes.header.entries.iter().map(|coded| coded.entry.view).collect()
            }
            _ => (0..header.capture.views.len()).collect(),
        };
        best.resize(order.len(), f64::INFINITY);
        for (view, best) in order.into_iter().zip(&mut best) {
            let began = Instant::now();
            while let Poll::Ready(ViewStatus::InProgress) = file.view(view)? {}
            *best = best.min(began.elapsed().as_secs_f64() * 1e3);
        }
    }
    println!("{}", serde_json::to_string(&best)?);
    Ok(())
}
