"""What a photo of a coupon tells of the printer: where its rings are, and where its ink ends."""
