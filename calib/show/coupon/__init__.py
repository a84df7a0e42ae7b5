"""What is told of a coupon."""
