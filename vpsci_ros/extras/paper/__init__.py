"""The paper's studies (Tables 3, 5, 9), section 4 and Turing test, its authors' files, and measures of realism."""
