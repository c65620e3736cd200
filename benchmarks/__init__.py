"""What is measured rather than tested: speed as ratios within one run, studies, comparisons."""
