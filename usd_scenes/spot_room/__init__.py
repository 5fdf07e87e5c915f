"""A gallery under spotlights: hard borders of shadows and of pools of light."""
