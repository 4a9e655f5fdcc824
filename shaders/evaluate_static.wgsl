// Stage evaluate for a static field: unpacks the Gaussian's record.

fn evaluate(index: u32) -> Instant {
    return at_rest(gaussians[index]);
}
