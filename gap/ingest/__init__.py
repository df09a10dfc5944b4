"""Any log → recordings: read as columns, mapped onto the model's joints, laid out in rows."""
