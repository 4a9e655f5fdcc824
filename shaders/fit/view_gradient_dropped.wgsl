// Where cameras are not learned, their gradient is not kept.

fn put_view(i: u32, gradient: ViewGradient) {}
