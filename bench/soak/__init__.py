"""Hours with an arm, a hand, faults and people, all at random: what grows, and what breaks?"""
