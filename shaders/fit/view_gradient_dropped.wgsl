fn put_view(i: u32, gradient: ViewGradient) {}
