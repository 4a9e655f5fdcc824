// Stage evaluate for a field in which nothing moves or fades: there is nothing to do.

fn evaluate(index: u32) -> Instant {
    return at_rest(gaussians[index]);
}
