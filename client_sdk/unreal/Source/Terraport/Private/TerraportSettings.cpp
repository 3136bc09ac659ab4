#include "TerraportSettings.h"

FTerraportBudgets FTerraportBudgets::For(ETerraportDevice Device)
{
	FTerraportBudgets Budgets;
	switch (Device)
	{
	case ETerraportDevice::Headset:
		// Two eyes, 72 times a second, on a phone's graphics: triangles are scarce, and draw calls; memory less so.
		Budgets.MaxTriangles = 900000;
		Budgets.MaxSegments = 512;
		Budgets.CacheMiB = 96;
		Budgets.DiskMiB = 512;
		Budgets.CreditMiB = 8;
		Budgets.MaxGpuMebibytes = 512;
		break;
	case ETerraportDevice::Phone:
		// An app that takes more than a few hundred MiB is closed by the phone's system, graphics memory included.
		Budgets.MaxTriangles = 1500000;
		Budgets.MaxSegments = 1024;
		Budgets.CacheMiB = 48;
		Budgets.DiskMiB = 256;
		Budgets.CreditMiB = 4;
		Budgets.MaxGpuMebibytes = 256;
		break;
	case ETerraportDevice::Desktop:
	case ETerraportDevice::Custom:
		break;
	}
	return Budgets;
}
